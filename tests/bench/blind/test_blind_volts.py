"""Voltages and loads that the program of a robot on its feet reads as well."""

from collections import Counter

import numpy as np
import pyarrow.compute as pc
import pytest

from bench.blind import Asked, legged_sizing
from bench.blind.drafts import LeggedDraft
from bench.blind.drives import Electrics
from bench.blind.legged_case import LOAD, READ, READS, SENSE, VOLTAGE, draw_legged
from bench.blind.scenes import SCENES, play
from bench.motions import StandPlan, WalkPlan

SCENE = SCENES["marvin-walk"]
NULL = Asked(kind="null", rig="marvin-walk")
RAIL_V = 7.4
COUNT_V = 0.1


def shown(register, electrics, *, reads, plan=None):
    """Rows of a register of a short walk of the robot as believed."""
    plan = plan or WalkPlan(seconds=0.5)
    body = legged_sizing.believed(SCENE, plan).body
    table = play(SCENE, plan, body, electrics, reads=reads).session.recorder.table()
    return table.filter(pc.equal(table["register"], register))


def test_servos_tell_their_voltage_by_turns_and_only_where_they_are_asked():
    assert len(shown(VOLTAGE, Electrics(), reads=())) == 0
    rows = shown(VOLTAGE, Electrics(), reads=(VOLTAGE,))
    ids = rows["servo_id"].to_pylist()
    assert len(ids) > len(SCENE.joints)
    assert ids[: len(SCENE.joints)] == list(SCENE.robot.by_id)
    assert set(rows["op"].to_pylist()) == {"read"}
    volts = rows["raw"].to_numpy() * COUNT_V
    assert (volts <= RAIL_V + COUNT_V).all()
    assert volts.mean() > 0.95 * RAIL_V


def test_a_register_shows_what_its_own_divider_makes_of_it():
    joint = SCENE.joints[4]
    rows = shown(VOLTAGE, Electrics(sense_v={joint: -1.0}), reads=(VOLTAGE,))
    own = rows["servo_id"].to_numpy() == SCENE.robot.by_joint[joint].servo_id
    raw = rows["raw"].to_numpy()
    assert raw[~own].mean() - raw[own].mean() == pytest.approx(10.0, abs=1.0)


@pytest.mark.slow
def test_every_servo_tells_its_load_as_well_and_a_lower_gain_makes_it_less():
    """The weight asks for a torque, so a lower gain of a robot that stands moves the joint."""
    duties = []
    for factor in (1.0, 0.5):
        gains = dict.fromkeys(SCENE.joints, factor)
        rows = shown(
            LOAD,
            Electrics(gain_factor=gains),
            reads=(VOLTAGE, LOAD),
            plan=StandPlan("squat"),
        )
        assert set(rows["servo_id"].to_pylist()) == set(SCENE.robot.by_id)
        size = rows["raw"].to_numpy() % 1024
        femurs = [s.servo_id for s in SCENE.robot.servos if s.joint.endswith("femur")]
        duties.append(size[np.isin(rows["servo_id"].to_numpy(), femurs)])
    assert np.median(duties[0]) > 100.0
    assert np.median(duties[1]) == pytest.approx(np.median(duties[0]), rel=0.15)


def test_what_is_read_is_drawn_by_its_shares_and_voltages_are_a_little_off():
    cases = [draw_legged(seed, NULL) for seed in range(90)]
    styles = Counter(case.style for case in cases)
    for style, share in zip(READS, READ, strict=True):
        spread = np.sqrt(share * (1.0 - share) / len(cases))
        assert abs(styles[style] / len(cases) - share) < 3.0 * spread
    off = np.array([list(case.nuisances.sense_v.values()) for case in cases]) / RAIL_V
    assert np.abs(off).max() <= sum(SENSE)
    assert np.std(off.mean(axis=1)) > 0.4 * SENSE[0]
    assert np.std(off - off.mean(axis=1, keepdims=True)) > 0.4 * SENSE[1]


@pytest.mark.parametrize("style", READS)
@pytest.mark.slow
def test_what_is_read_can_be_asked_for_and_stands_in_the_key(style):
    told = LeggedDraft(3, Asked(kind="null", rig="marvin-stand", style=style)).told()
    assert (told["style"], told["programme"]) == (style, "stand")


def test_an_unknown_style_is_refused_with_those_there_are():
    with pytest.raises(ValueError, match="no style 'smell' on marvin-walk: one of position; "):
        draw_legged(1, Asked(kind="null", rig="marvin-walk", style="smell"))


def test_a_leg_on_a_stand_reads_positions_alone():
    every = [draw_legged(s, Asked(kind="null", rig="marvin-leg")) for s in range(10)]
    assert {case.style for case in every} == {"position"}
