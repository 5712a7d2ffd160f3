"""The named motions and the plan of an experiment."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bench.motions import MOTIONS, ExperimentPlan, Motion, motion


@pytest.mark.parametrize("name", MOTIONS)
def test_motion_stays_within_its_amplitude_and_uses_it(name: str) -> None:
    made = motion(name, amplitude_rad=0.7, center_rad=0.2, duration_s=5.0)
    away = np.abs(made.goal_rad(np.linspace(-1.0, 6.0, 7001)) - 0.2)
    assert away.max() <= 0.7 + 1e-12
    assert away.max() >= 0.7 * 0.85


@pytest.mark.parametrize("name", MOTIONS)
def test_motion_stands_still_before_and_after(name: str) -> None:
    made = motion(name, duration_s=4.0)
    assert made.goal_rad(-3.0) == made.goal_rad(0.0)
    assert made.goal_rad(99.0) == made.goal_rad(4.0)


@pytest.mark.parametrize("name", sorted(set(MOTIONS) - {"steps"}))
def test_motion_has_no_jump(name: str) -> None:
    goals = motion(name).goal_rad(np.arange(0.0, 6.0, 1e-3))
    assert np.abs(np.diff(goals)).max() < 0.02


def test_slow_ramp_goes_up_and_comes_down() -> None:
    ramp = motion("slow_ramp", duration_s=6.0)
    assert ramp.goal_rad([0.0, 3.0, 6.0]).tolist() == [-1.0, 1.0, -1.0]


def test_dither_reverses_many_times() -> None:
    goals = motion("dither").goal_rad(np.arange(0.0, 6.0, 1e-3))
    turns = np.count_nonzero(np.diff(np.sign(np.diff(goals))))
    assert turns >= 8


def test_lift_and_drop_says_when_the_torque_goes_off() -> None:
    assert motion("lift_and_drop", lift_s=1.5).torque_off_s == 1.5
    assert motion("hold").torque_off_s is None


@pytest.mark.parametrize("name", MOTIONS)
def test_plan_survives_json(name: str) -> None:
    plan = ExperimentPlan(
        motion(name, center_rad=0.3), {"position_p_gain": 200}, 0.1, 0.08, 30.0, "a"
    )
    assert ExperimentPlan.of(json.loads(json.dumps(plan.document()))) == plan


def test_every_motion_describes_itself_in_a_line() -> None:
    for name, kind in MOTIONS.items():
        assert kind.name == name
        assert 10 < len(kind.description) < 80


def test_unknown_names_are_refused_with_those_there_are() -> None:
    with pytest.raises(ValueError, match="no motion named 'jump': use one of sin_sin, chirp"):
        motion("jump")
    with pytest.raises(ValueError, match="hold has no hz: it has amplitude_rad"):
        motion("hold", hz=2.0)
    with pytest.raises(ValueError, match="a plan has no speed"):
        ExperimentPlan.of({"motion": "hold", "speed": 1})
    with pytest.raises(ValueError, match="a plan needs its motion"):
        ExperimentPlan.of({})


def test_base_motion_is_no_motion() -> None:
    with pytest.raises(TypeError, match="abstract method"):
        Motion()
