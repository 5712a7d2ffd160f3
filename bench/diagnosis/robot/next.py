"""Which walk would tell two explanations of a whole robot apart.

Both are replayed in every experiment of a menu: the walk that was recorded with another weight on
the trunk, with the body held and the legs free, with the height of the trunk watched, or with the
voltage or the loads read. What tells them apart is as for one joint
(:mod:`bench.diagnosis.joint.next_experiment`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from sim.stepped import TICK_S

from ..joint.next_experiment import adapted, most_telling, separated
from ..noise import Noise
from ..result import NextExperiment
from .features import MEANS, RobotKind
from .fit import DUTY_NOISE, RobotFit, Sight, voltage_noise
from .leaning import AXES
from .model import HEIGHT_FLOOR_M, LEAN_FLOOR_RAD, RobotModel
from .replay import LEANS, Course

Floats = NDArray[np.float64]

HEAVIER = 0.15  #: of the robot's mass: a weight to put on its trunk; assumed
WATCH_S = 0.02  #: between two looks at the trunk's height, at a voltage, or at a load of any servo
MEMORY_S = 0.1  #: of a height's noise, and of a lean's; assumed
LEAN_LEVEL_RAD = 3e-3  #: of a lean that tolerances of joints make; assumed


@dataclass(frozen=True, slots=True, eq=False)
class RobotChoice:
    """An experiment of the menu: its name and arguments, and what it would be replayed as."""

    experiment: str
    arguments: Mapping[str, Any]
    course: Course


def menu(model: RobotModel) -> list[RobotChoice]:
    """What can be done with the first walk that was recorded."""
    told = replace(model.features[0].course, height=None, lean=None)
    weight = round(HEAVIER * model.base.mass_kg, 3)
    before = float(told.condition.get("trunk_load_kg", told.condition.get("payload_kg", 0.0)))
    heavier = {k: v for k, v in told.condition.items() if k != "payload_kg"}
    heavier["trunk_load_kg"] = before + weight
    held = dict(told.condition) | {"support": "suspended"}
    times = np.arange(0.0, told.end_s - TICK_S, WATCH_S)
    choices = [
        RobotChoice(
            "locomotion",
            {"trunk_load_kg": before + weight},
            replace(told, name="heavier", group="heavier", condition=heavier),
        ),
        RobotChoice(
            "locomotion",
            {"support": "suspended"},
            replace(told, name="held", group="held", condition=held),
        ),
    ]
    if all(f.course.height is None for f in model.features):
        watched = replace(
            told, name="watched", group="watched", height=(times, np.zeros(len(times)))
        )
        choices.append(RobotChoice("locomotion", {"observe": "mocap/base_z_m"}, watched))
    if all(f.course.lean is None for f in model.features):
        leans = np.zeros((len(times), AXES))
        sensed = replace(told, name="sensed", group="sensed", lean=(times, leans))
        choices.append(RobotChoice("locomotion", {"observe": ", ".join(LEANS[0])}, sensed))
    if all(f.course.voltage is None for f in model.features):
        read = replace(told, name="read", group="read", voltage=(times, np.zeros(len(times))))
        choices.append(RobotChoice("locomotion", {"read": "present_voltage"}, read))
    if not any(len(t_s) for f in model.features for t_s, _ in f.course.duty):
        loads = replace(told, name="loads", group="loads", duty=_by_turns(told))
        choices.append(RobotChoice("locomotion", {"read": "present_load"}, loads))
    return choices


def _by_turns(told: Course) -> tuple[tuple[Floats, Floats], ...]:
    """Instants [s] at which loads of a course would be read, one servo after another."""
    joints = len(told.sample_s)
    every = [np.arange(j * WATCH_S, told.end_s, joints * WATCH_S) for j in range(joints)]
    return tuple((t_s, np.zeros(len(t_s))) for t_s in every)


def next_experiments(
    sight: Sight,
    robot: Robot,
    named: RobotFit,
    rivals: Mapping[str, RobotFit],
    inflation: float,
) -> list[NextExperiment]:
    """Experiments of the menu that tell a named hypothesis from its rivals: first from all.

    ``sight`` is that which all were fitted with.
    """
    if not rivals:
        return []
    model = sight.model
    choices = menu(model)
    watched = Noise(HEIGHT_FLOOR_M, 0.1 * HEIGHT_FLOOR_M, MEMORY_S)
    apart = {}
    with RobotModel(model.base, robot, [choice.course for choice in choices]) as imagined:
        noise = {RobotKind.HEIGHT: watched, RobotKind.VOLTAGE: voltage_noise(imagined, 1)}
        noise[RobotKind.LEAN] = Noise(LEAN_FLOOR_RAD, LEAN_LEVEL_RAD, MEMORY_S)
        noise[RobotKind.DUTY] = DUTY_NOISE
        noise |= dict(named.noise)
        for rival, other in rivals.items():
            known = np.asarray(np.linalg.inv(sight.covariances(other)[0]), np.float64)
            apart[rival] = [
                _distance(Sight(imagined, [r], MEANS), named, other, noise, known)
                / np.sqrt(inflation)
                for r in range(len(choices))
            ]
    found = []
    for best, told, power in most_telling(apart):
        ours, *others = (_effects(fit) for fit in (named, *(rivals[rival] for rival in told)))
        choice, parted = choices[best], separated(ours, others) or told
        found.append(NextExperiment(choice.experiment, dict(choice.arguments), parted, power))
    return found


def _effects(found: RobotFit) -> list[str]:
    """Effects of a fit, wherever they are."""
    return [name.partition("@")[0] for name in found.names]


def _distance(
    sight: Sight,
    named: RobotFit,
    other: RobotFit,
    noise: Mapping[RobotKind, Noise],
    known: Floats,
) -> float:
    """How far apart two hypotheses are in one experiment, in deviations, the other adapted."""
    ours, _ = sight.linearised(named.names, named.z, noise)
    theirs, jacobian = sight.linearised(other.names, other.z, noise)
    return adapted(theirs - ours, jacobian, known)
