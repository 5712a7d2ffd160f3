"""Six oscillators, one a leg, joined by symmetric inhibition: the rhythm of a tripod gait.

Every leg inhibits its neighbours: the leg across the trunk, and the legs before and behind it on
its own side. Who inhibits each other ends up in antiphase, so the front and rear leg of one side
step with the middle leg of the other: the two tripods. The links are symmetric, and weighted so
that every leg takes the same sum of inhibition: then the locked rhythm is the same for all legs.

Read-out. A unit's two antisymmetric variables, ``p = u_extensor - u_flexor`` and ``q = v_extensor
- v_flexor``, circle the origin. The angle on that orbit is read as a *phase* that grows evenly in
time (by a table of the locked orbit), and the distance from the origin as an *amplitude*, 1 on the
orbit. Phase 0 is where the extensor takes over from the flexor, 0.5 where it hands back: a leg
stands while its extensor leads, and swings while its flexor does.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from busemu.tables import RobotError

from ..legs import Legs
from .oscillator import STEP, Array, OscillatorParameters, Oscillators

#: Sum of the inhibition each leg takes from its neighbours; assumed: locks within some periods.
COUPLING = 1.0
#: Random start states are drawn between 0 and this. Small beside the locked rhythm, whose ``u``
#: reaches about 1: the start-up can be seen, and begins near the neutral posture. Assumed.
START_STATE = 0.05
#: Time [tau_r] after which a start on the symmetric orbit has come to rest on it, and its length.
SETTLING = 400.0


@dataclass(frozen=True)
class Orbit:
    """The locked rhythm of one unit: what turns a state into phase and amplitude."""

    period: float  #: [tau_r]
    p_amplitude: float
    q_amplitude: float
    angle_rad: Array  #: rising from angle_rad[0] by 2 pi, where ...
    phase: Array  #: ... the phase rises evenly from 0 to 1
    radius: Array  #: distance from the origin at that angle


@dataclass(frozen=True)
class Rhythm:
    """What the network says at one instant: an entry a leg."""

    phase: Array  #: 0 to 1; below 0.5 the extensor leads
    amplitude: Array  #: 0 at rest, 1 on the locked orbit
    extensor_leads: Array  #: bool


def neighbours(legs: Legs) -> Array:
    """Coupling weights (6, 6), symmetric, each row of sum 1, from where the legs are.

    Raises :class:`RobotError` unless there are three legs on each side.
    """
    x, y = legs.hips_m.T
    sides = [np.flatnonzero(side) for side in (x < 0.0, x > 0.0)]
    if len(legs.names) != 6 or any(len(side) != 3 for side in sides):
        raise RobotError(
            "the tripod network needs six legs, three on each side of the trunk: of the [[leg]] "
            f"there are {len(sides[0])} with x_m below 0 m, {len(sides[1])} above"
        )
    left, right = (side[np.argsort(-y[side])] for side in sides)  # front, middle, rear
    weights = np.zeros((6, 6))
    for a, b, weight in (
        (left[0], right[0], 2.0),
        (left[1], right[1], 1.0),
        (left[2], right[2], 2.0),
        (left[0], left[1], 1.0),
        (left[1], left[2], 1.0),
        (right[0], right[1], 1.0),
        (right[1], right[2], 1.0),
    ):
        weights[a, b] = weights[b, a] = weight / 3.0
    return weights


def tripods(legs: Legs) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the legs of the two tripods: the halves that inhibit only each other."""
    linked = neighbours(legs) > 0.0
    same_half = np.linalg.matrix_power(linked.astype(int), 4)[0] > 0  # an even number of links away
    names = legs.names
    return (
        tuple(name for i, name in enumerate(names) if same_half[i]),
        tuple(name for i, name in enumerate(names) if not same_half[i]),
    )


@lru_cache
def locked_orbit(parameters: OscillatorParameters, coupling: float) -> Orbit:
    """Follow the locked rhythm once: two units in antiphase stand for the two tripods."""
    state = np.array([[0.5, -0.5], [-0.5, 0.5], [0.1, 0.0], [0.0, 0.1]])
    pair = Oscillators(parameters, coupling * np.array([[0.0, 1.0], [1.0, 0.0]]), state)
    count = round(SETTLING / STEP)
    track = np.empty((count, 2))
    for k in range(count):
        z = pair.state
        track[k] = z[0, 0] - z[1, 0], z[2, 0] - z[3, 0]
        pair.advance(STEP)
    p, q = track.T
    rising = np.flatnonzero((p[:-1] < 0.0) & (p[1:] >= 0.0))
    if len(rising) < 3:
        raise ValueError("this network does not oscillate: choose other weights")
    crossings = rising - p[rising] / (p[rising + 1] - p[rising])
    start, end = crossings[-2], crossings[-1]
    samples = np.linspace(start, end, 257)
    steps = np.arange(count)
    p, q = np.interp(samples, steps, p), np.interp(samples, steps, q)
    p_amplitude, q_amplitude = np.abs(p).max(), np.abs(q).max()
    angle = np.unwrap(np.arctan2(q / q_amplitude, p / p_amplitude))
    if not np.all(np.diff(angle) > 0.0):
        raise ValueError("the locked orbit does not circle the origin: choose other weights")
    angle[-1] = angle[0] + 2.0 * np.pi
    return Orbit(
        period=float((end - start) * STEP),
        p_amplitude=float(p_amplitude),
        q_amplitude=float(q_amplitude),
        angle_rad=angle,
        phase=np.linspace(0.0, 1.0, 257),
        radius=np.hypot(q / q_amplitude, p / p_amplitude),
    )


class Network:
    """The six coupled oscillators of a robot, running at a period of ``period_s`` once locked.

    They start from states drawn with ``seed``. Legs are in the order of ``legs``.
    """

    def __init__(
        self,
        legs: Legs,
        period_s: float,
        seed: int,
        *,
        parameters: OscillatorParameters | None = None,
        coupling: float = COUPLING,
        step: float = STEP,
    ) -> None:
        if not period_s > 0.0:
            raise ValueError(f"period_s must be positive, got {period_s}")
        parameters = parameters or OscillatorParameters()
        self.orbit = locked_orbit(parameters, coupling)
        self._tau_r_s = period_s / self.orbit.period
        state = np.random.default_rng(seed).uniform(0.0, START_STATE, (4, 6))
        self.oscillators = Oscillators(parameters, coupling * neighbours(legs), state, step=step)

    def advance(self, duration_s: float) -> None:
        """Go on by ``duration_s`` [s]. Raises ``ValueError`` if it is negative."""
        self.oscillators.advance(duration_s / self._tau_r_s)

    def rhythm(self) -> Rhythm:
        """Read the network at the present instant."""
        orbit = self.orbit
        u_extensor, u_flexor, v_extensor, v_flexor = self.oscillators.state
        p = (u_extensor - u_flexor) / orbit.p_amplitude
        q = (v_extensor - v_flexor) / orbit.q_amplitude
        start = orbit.angle_rad[0]
        angle = start + np.mod(np.arctan2(q, p) - start, 2.0 * np.pi)
        return Rhythm(
            phase=np.interp(angle, orbit.angle_rad, orbit.phase),
            amplitude=np.hypot(p, q) / np.interp(angle, orbit.angle_rad, orbit.radius),
            extensor_leads=p >= 0.0,
        )
