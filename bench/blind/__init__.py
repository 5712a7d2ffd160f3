"""An independent reality on MuJoCo that makes sealed cases with a concealed effect.

Nothing here is the emulator's own simulator; what is known of a case outside this package is what
an operator would believe, until the key is opened.
"""

from .case import Asked, Case, Concealment, Hidden, Kind, draw
from .cases import open_key, open_truth, read_public, rerun, write_case
from .seal import SealError

__all__ = [
    "Asked",
    "Case",
    "Concealment",
    "Hidden",
    "Kind",
    "SealError",
    "draw",
    "open_key",
    "open_truth",
    "read_public",
    "rerun",
    "write_case",
]
