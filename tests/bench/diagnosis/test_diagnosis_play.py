"""Play that is seen in the data: pushes from outside while a goal stands still."""

from math import nan
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.joint.play import LEAST, play, play_cause
from bench.diagnosis.observed import observe
from bench.recording import Recording
from busemu.tables import load_robot

RIG = "sts3215-lever"
SERVO, JOINT = 5, "lever"
COUNT_RAD = 2.0 * np.pi / 4096
PACE_S = 0.1
HOME = 2047


def pushed(levels, goal=lambda k: HOME, stay=5):
    """A joint that stands at some counts from home, one after the other."""
    rows = []
    for k, level in enumerate(np.repeat(levels, stay)):
        t_s = PACE_S * k
        rows.append(access(t_s, "write", "goal_position", goal(k)))
        rows.append(access(t_s + 0.01, "read", "present_position", HOME + level))
    return Recording.of(rows, {"name": "pushed", "robot": RIG})


def access(t_s, op, name, raw):
    reply = t_s + 0.001 if op == "read" else nan
    return SimpleNamespace(
        t_s=t_s, t_reply_s=reply, servo_id=SERVO, op=op, register=name, raw=float(raw)
    )


def seen(*recordings):
    return play(observe(recordings, load_robot(RIG), JOINT))


TO_AND_FRO = [0, *(8, 4, -9, -3) * LEAST]


def test_what_is_kept_on_either_side_is_the_play_and_it_grows_with_load():
    found = seen(pushed(TO_AND_FRO))
    assert found.kept_rad == pytest.approx(7 * COUNT_RAD)
    assert found.pushed_rad == pytest.approx(17 * COUNT_RAD)
    assert found.pushes == 2 * LEAST
    assert "1.49 deg" in found.words
    assert "0.62 deg" in found.words


def test_the_cause_has_its_rivals_and_an_interval_around_it():
    found = seen(pushed(TO_AND_FRO))
    cause = play_cause(found, JOINT, 0.002)
    low, high = cause.parameters["width_rad"].ci95
    assert low < 7 * COUNT_RAD < high
    total = cause.probability + sum(r.probability for r in cause.indistinguishable_from)
    assert total == pytest.approx(1.0)
    assert "coulomb_friction" in {r.effect for r in cause.indistinguishable_from}


@pytest.mark.parametrize(
    "levels",
    [
        [0] * 12,
        [0, *(8, 4) * 6],  # to one side only
        [0, *(8, 4, -9, -3) * (LEAST - 1)],  # too few
        [0, *(8, -9) * 6],  # hunting: from one side to the other
        [9, 7, 5, 3, -9, -7, -5, -3] * 2,  # creeping to the goal
    ],
)
def test_where_nobody_pushes_to_and_fro_there_is_none(levels):
    assert seen(pushed(levels)) is None


def test_what_a_goal_moves_is_no_push():
    assert seen(pushed(TO_AND_FRO, goal=lambda k: HOME + 40 * (k // 5 % 2))) is None


def test_a_joint_that_is_only_passing_by_does_not_stand():
    assert seen(pushed(TO_AND_FRO, stay=2)) is None
