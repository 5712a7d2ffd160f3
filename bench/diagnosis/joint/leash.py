"""Replays on a leash: led along what was recorded, so that they cannot lose its way.

A joint that hunts, as its gear has play or gives, swings by itself. A replay that does not swing is
no worse than one that swings by a period a little off: samples compared one by one tell a fit
nothing of which way to go, and after some swings not even the truth keeps step. So its load is led
by a spring and a critical damper towards where the recording was; alone they would bring it there
at :data:`LEASH_RAD_S`, slowly enough that the joint still makes its own motion. This is an observer
with a fixed gain, and what is compared are its errors of prediction (Ljung, System Identification,
2nd ed., 1999, 3.2); with a model that lacks nothing it pulls at nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from sim.stepped import TICK_S

from ..observed import Observed
from .left import good

Floats = NDArray[np.float64]

LEASH_RAD_S = 5.0  #: of joints that hunt, which is at 2 to 10 Hz; assumed
#: times what a cause leaves on a leash that the joint as believed leaves there, and that cause
#: without a leash, for the joint to hunt
HUNTS = 1.5
GATED = 3  #: effects that are fitted to see whether a joint hunts
DEGREE = 3  #: of the polynomials between samples


def path(observed: Observed) -> Floats:
    """Angle [rad] and speed [rad/s] that a servo showed, at every tick of a drive (ticks, 2)."""
    samples = observed.position
    t_s, first = np.unique(samples.t_s[samples.good], return_index=True)
    shown = make_interp_spline(t_s, good(observed)[first], k=min(DEGREE, len(t_s) - 1))
    ticks = np.arange(int(np.ceil(observed.replay.end_s / TICK_S)) + 1) * TICK_S
    ticks = np.clip(ticks, t_s[0], t_s[-1])
    return np.stack([shown(ticks), shown(ticks, 1)], axis=1)
