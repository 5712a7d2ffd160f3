"""What the gear is that the operator believes in: rigid, or the spring of the robot file.

No data sheet gives a gear's stiffness, so that a file's is assumed, and most gears of small servos
are stiffer than a physics engine carries. A rigid one is tried first, as it is simple; the file's
is believed where recordings, all tolerances fitted, follow it plainly better. Neither is a finding.
What else is hidden can make one look like the other, so it is asked again of what is found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from busemu.tables import Robot
from sim.robot import PhysicalRobot

from ..journal import Journal
from ..observed import Observed
from .fit import Fit, fit
from .model import GEARS, Hypothesis, JointModel
from .valleys import elsewhere

PLAINLY = 7.0  #: gain [nats] at which the file's spring is believed


class SpringError(Exception):
    """With what was found, recordings follow the file's spring, and a rigid gear was believed."""


def believed(
    base: PhysicalRobot,
    robot: Robot,
    observed: Sequence[Observed],
    journal: Journal | None = None,
    load_refresh_s: float | None = None,
) -> tuple[JointModel, Fit]:
    """The joint as its operator believes it, and that with all tolerances fitted."""
    rigid = JointModel(base, robot, observed, journal, load_refresh_s)
    before = _fitted(rigid)
    other = sprung(rigid)
    if other is None:
        return rigid, before
    return other if other[1].cost < before.cost - PLAINLY else (rigid, before)


def sprung(rigid: JointModel) -> tuple[JointModel, Fit] | None:
    """The same joint with the spring of its file, and that fitted; none where it has none."""
    model = with_spring(rigid)
    if model is rigid:
        return None
    return model, _fitted(model)


def _fitted(model: JointModel) -> Fit:
    """All tolerances of a joint fitted, begun as believed and with more and less friction."""
    return elsewhere(model, fit(model, Hypothesis(), np.zeros(len(model.nuisances))))


def asked_again(rigid: JointModel) -> Callable[[Fit], None]:
    """What asks of a fit with effects whether the spring of the file follows it plainly better.

    It raises :class:`SpringError` if so, and never does of names about gears, which have a spring.
    """
    model = with_spring(rigid)
    if model is rigid:
        return lambda _: None

    def ask(found: Fit) -> None:
        if GEARS & set(found.hypothesis.effects):
            return
        other = fit(model, found.hypothesis, found.z, found.noise, rounds=3)
        if other.cost < found.cost - PLAINLY:
            raise SpringError

    return ask


def with_spring(model: JointModel) -> JointModel:
    """The joint with the spring of its file; the very model where it has it, or there is none."""
    stiffness = model.base.joints[model.index].drive.gear_stiffness_nm_rad
    if model.sprung or not math.isfinite(stiffness):
        return model
    return model.of(model.observed, sprung=True)
