"""How much joints shake from sample to sample, which means over the phase of the gait do not show.

A leg with play is thrown from flank to flank while it swings. When is chance, so phase means have
it as noise; how much is not, and sound engines agree about it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from sim.tree import SEGMENTS

from .gait import commanded_lift
from .robot_features import Features
from .robot_judging import Judgement

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: counts of the register by which joints that shake do so more than replays. Measured on robots of
#: a third engine: 0.16 at most where nothing is hidden, 1.7 with play of 3 deg
SHAKEN = 0.5
EVEN = 1.5  #: times the usual wait between two samples, beyond which a difference says nothing
PHASES = ("stance", "swing")


def shaking(
    robot: Robot, features: Sequence[Features], judged: Sequence[Judgement]
) -> Mapping[str, float]:
    """RMS by which joints shake more than modelled [rad], by ``"coxa swing"`` and so on.

    Shaking is the second difference of samples over the square root of 6, so that white noise has
    its own deviation. What all kinds of joints have in all phases is the sensors' noise and
    rounding, and taken off.
    """
    squares = {f"{segment} {phase}": [0.0, 0.0, 0.0] for segment in SEGMENTS for phase in PHASES}
    for found, one in zip(features, judged, strict=True):
        for j, mount in enumerate(robot.servos):
            segment = mount.joint.rpartition(".")[2]
            lifted, steady = _parts(robot, found, j)
            recorded = _roughness(one.course.position_rad[j])
            modelled = _roughness(one.modelled_rad[j])
            for phase, part in zip(PHASES, (~lifted, lifted), strict=True):
                cell, there = squares[f"{segment} {phase}"], part & steady
                cell[0] += float(np.sum(recorded[there]))
                cell[1] += float(np.sum(modelled[there]))
                cell[2] += float(np.sum(there))
    more = {name: (a - b) / n for name, (a, b, n) in squares.items() if n > 0}
    common = min(more.values(), default=0.0)
    return {name: math.sqrt(x - common) for name, x in more.items()}


def _roughness(angle_rad: Floats) -> Floats:
    """Squared second differences of samples over 6 [rad^2]: of a noise, its variance."""
    found: Floats = np.diff(angle_rad, 2) ** 2 / 6.0
    return found


def _parts(robot: Robot, features: Features, j: int) -> tuple[Bools, Bools]:
    """Whether a joint's leg is told to swing, and whether samples are even and the robot walks."""
    t = features.course.sample_s[j]
    legs = [str(leg["name"]) for leg in robot.document["leg"]]
    leg = legs.index(robot.servos[j].joint.split(".", maxsplit=1)[0])
    lifted: Bools = commanded_lift(features.course.goals, robot, t)[1:-1, leg]
    waits = np.diff(t)
    even = np.maximum(waits[1:], waits[:-1]) < EVEN * np.median(waits)
    return lifted, even & (features.bins[j].bin[1:-1] >= 0)


def told(more: Mapping[str, float], quantum_rad: float) -> tuple[str, ...]:
    """A sentence if legs shake in the air, where nothing but their own joints can shake them."""
    loose = {
        segment: more[f"{segment} swing"]
        for segment in SEGMENTS
        if more.get(f"{segment} swing", 0.0) > SHAKEN * quantum_rad
        and more[f"{segment} swing"] > more.get(f"{segment} stance", 0.0)
    }
    if not loose:
        return ()
    most = max(loose, key=lambda segment: loose[segment])
    return (
        f"{most} joints shake while their legs swing, {1e3 * loose[most]:.1f} mrad from sample to "
        "sample more than the model's: teeth with play do so (backlash), and means over the phase "
        "of the gait hardly show it",
    )
