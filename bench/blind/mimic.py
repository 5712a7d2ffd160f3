"""Rivals: other effects that give nearly the same trace."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from .changes import Setting
from .sizing import Key, Size, change, effect_named, rms, size_for

ALIKE = 0.6  #: a rival whose trace differs by less than this share of the effect's is a mimic


@dataclass(frozen=True, slots=True)
class Rival:
    """An effect that comes near to another; ``unlike`` 0 is a perfect mimic.

    ``unlike``: RMS of the difference of the two traces over the RMS of the first.
    """

    effect: str
    size: float
    sign: int
    unlike: float


@lru_cache(maxsize=1024)
def nearest_rival(key: Key, name: str, at: Size, how: Setting) -> Rival | None:
    """The rival of an effect that comes nearest to its trace, each as large as the effect."""
    true = change(key, name, at.size, how)
    best: Rival | None = None
    for other in effect_named(name).rivals:
        for sign in (-1, 1) if effect_named(other).signed else (1,):
            setting = Setting(sign)
            found = size_for(key, other, at.ratio, setting)
            if found is None:
                continue
            unlike = rms(true - change(key, other, found.size, setting)) / rms(true)
            if best is None or unlike < best.unlike:
                best = Rival(other, found.size, sign, unlike)
    return best
