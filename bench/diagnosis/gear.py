"""What the gear is that the operator believes in: rigid, or the spring of the robot file.

No data sheet gives a gear's stiffness, so that a file's is assumed, and most gears of small servos
are stiffer than a physics engine carries. A rigid one is tried first, as it is simple; the file's
is believed where recordings, all tolerances fitted, follow it plainly better. Neither is a finding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from busemu.tables import Robot
from sim.robot import PhysicalRobot

from .fit import Fit, fit
from .journal import Journal
from .model import Hypothesis, JointModel
from .observed import Observed

PLAINLY = 7.0  #: gain [nats] at which the file's spring is believed


def believed(
    base: PhysicalRobot,
    robot: Robot,
    observed: Sequence[Observed],
    journal: Journal | None = None,
    load_refresh_s: float | None = None,
) -> tuple[JointModel, Fit]:
    """The joint as its operator believes it, and that with all tolerances fitted."""
    rigid = JointModel(base, robot, observed, journal, load_refresh_s)
    before = fit(rigid, Hypothesis(), np.zeros(len(rigid.nuisances)))
    other = sprung(rigid)
    if other is None:
        return rigid, before
    return other if other[1].cost < before.cost - PLAINLY else (rigid, before)


def sprung(rigid: JointModel) -> tuple[JointModel, Fit] | None:
    """The same joint with the spring of its file, and that fitted; none where it has none."""
    if rigid.sprung or math.isinf(rigid.base.joints[rigid.index].drive.gear_stiffness_nm_rad):
        return None
    model = rigid.of(rigid.observed, sprung=True)
    return model, fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
