"""What a robot does on its feet without walking: own programmes, on the robot's own software."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from bench.motions import STANDING, StandPlan
from bench.running import Session
from hal.cpg.gait import Gait
from hal.cpg.network import tripods
from hal.legs import Legs
from hal.robot_control import RobotControl

Floats = NDArray[np.float64]

#: times [s], ways [m] and angles [rad] are assumed: slow enough that feet stay where they are
STAND_UP_S, WAY_S, STAY_S, STRETCH_S = 1.5, 1.2, 0.3, 3.0
SINK_M, RISE_M, ASIDE_M = 0.02, 0.01, 0.02
LIFT_M, STRETCH_RAD = 0.03, 0.3
#: where the trunk goes in turn: x to the right, y forward, z up
PLACES_M = {
    "squat": ((0.0, 0.0, -SINK_M), (0.0, 0.0, RISE_M)) * 2,
    "sway": ((ASIDE_M, 0.0, 0.0), (-ASIDE_M, 0.0, 0.0), (0.0, ASIDE_M, 0.0), (0.0, -ASIDE_M, 0.0)),
}


def ways(plan: StandPlan, gait: Gait, legs: Legs) -> Iterator[tuple[Floats, float]]:
    """Postures, one after another: angles [rad] of shape (legs, 3), and how long each way is [s].

    Raises ``ValueError`` for a programme that there is none of.
    """
    neutral = legs.stretched(gait.neutral_coxa_rad, gait.neutral_femur_rad, gait.neutral_tibia_rad)
    feet = legs.feet_m(neutral)
    yield neutral, STAND_UP_S
    if plan.programme == "stretch":
        standing, lifted = tripods(legs)
        up = np.array([name in lifted for name in legs.names])
        three = legs.angles_rad(feet + np.outer(up, (0.0, 0.0, LIFT_M)))
        # the middle leg is the one that stands nearest to the middle of the trunk's length
        middle = min(standing, key=lambda name: abs(legs.hips_m[legs.names.index(name), 1]))
        far = three.copy()
        far[legs.names.index(middle), 2] += STRETCH_RAD
        yield from ((three, WAY_S), (far, STRETCH_S), (three, STRETCH_S))
    elif plan.programme in PLACES_M:
        for place in PLACES_M[plan.programme]:
            yield legs.angles_rad(feet - np.array(place)), WAY_S
    else:
        raise ValueError(f"no standing programme {plan.programme!r}: {', '.join(STANDING)}")
    yield neutral, WAY_S


def stand(session: Session, plan: StandPlan, then: Callable[[float], None]) -> None:
    """Go through a programme, and let go. ``then`` is called after every cycle."""
    robot, clock = session.robot, session.clock
    gait, legs = Gait.of(robot), Legs.of(robot)
    control = RobotControl(robot, session.client, legs.joints)
    at = control.read_positions()
    control.unlimit_speed()
    control.set_goals(at)
    control.torque_on()
    for posture, seconds in ways(plan, gait, legs):
        goal, began_s = posture.ravel(), clock.now_s()
        while (t_s := clock.now_s() - began_s) < seconds + STAY_S:
            share = min(t_s / seconds, 1.0)
            control.set_goals(at + share * share * (3.0 - 2.0 * share) * (goal - at))
            control.read_positions()
            then(t_s)
            clock.sleep_until(began_s + t_s + gait.cycle_s)
        at = goal
    control.torque_off()
