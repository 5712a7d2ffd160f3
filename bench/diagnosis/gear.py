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
    if math.isinf(base.joints[rigid.index].drive.gear_stiffness_nm_rad):
        return rigid, before
    sprung = JointModel(base, robot, observed, journal, load_refresh_s, sprung=True)
    other = fit(sprung, Hypothesis(), np.zeros(len(sprung.nuisances)))
    return (sprung, other) if other.cost < before.cost - PLAINLY else (rigid, before)
