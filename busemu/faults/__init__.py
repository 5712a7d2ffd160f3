"""Faults of a bus: asked for in a scenario file or while it runs, and the same for the same seed.

:class:`Fault` says what shall go wrong, and when; :class:`Faults` lets it. A bus that was given no
faults knows nothing of this package. Random numbers come in from outside, as ``draw``.
"""

from .damage import Chance
from .fault import Fault, FaultError, Kind, parse_fault
from .faults import Faults, Standing
from .scenario import Scenario, load_scenario

__all__ = [
    "Chance",
    "Fault",
    "FaultError",
    "Faults",
    "Kind",
    "Scenario",
    "Standing",
    "load_scenario",
    "parse_fault",
]
