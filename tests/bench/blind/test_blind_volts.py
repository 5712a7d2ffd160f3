"""Voltages that a walking robot's program reads as well."""

import numpy as np
import pyarrow.compute as pc
import pytest

from bench.blind import Asked, legged_sizing
from bench.blind.drafts import LeggedDraft
from bench.blind.drives import Electrics
from bench.blind.legged_case import SENSE, VOLTS, draw_legged
from bench.blind.scenes import SCENES, play
from bench.motions import WalkPlan

SCENE = SCENES["marvin-walk"]
NULL = Asked(kind="null", rig="marvin-walk")
RAIL_V = 7.4
COUNT_V = 0.1


def voltages(electrics, *, volts=True):
    """Rows of the voltage register of a short walk of the robot as believed."""
    plan = WalkPlan(seconds=0.5)
    body = legged_sizing.believed(SCENE, plan).body
    table = play(SCENE, plan, body, electrics, volts=volts).session.recorder.table()
    return table.filter(pc.equal(table["register"], "present_voltage"))


def test_servos_tell_their_voltage_by_turns_and_only_where_they_are_asked():
    assert len(voltages(Electrics(), volts=False)) == 0
    rows = voltages(Electrics())
    ids = rows["servo_id"].to_pylist()
    assert len(ids) > len(SCENE.joints)
    assert ids[: len(SCENE.joints)] == list(SCENE.robot.by_id)
    assert set(rows["op"].to_pylist()) == {"read"}
    shown = rows["raw"].to_numpy() * COUNT_V
    assert (shown <= RAIL_V + COUNT_V).all()
    assert shown.mean() > 0.95 * RAIL_V


def test_a_register_shows_what_its_own_divider_makes_of_it():
    joint = SCENE.joints[4]
    rows = voltages(Electrics(sense_v={joint: -1.0}))
    own = rows["servo_id"].to_numpy() == SCENE.robot.by_joint[joint].servo_id
    raw = rows["raw"].to_numpy()
    assert raw[~own].mean() - raw[own].mean() == pytest.approx(10.0, abs=1.0)


def test_half_of_the_walks_read_voltages_that_are_a_little_off():
    cases = [draw_legged(seed, NULL) for seed in range(60)]
    share = np.mean([case.volts for case in cases])
    assert abs(share - VOLTS) < 3.0 * np.sqrt(VOLTS * (1.0 - VOLTS) / len(cases))
    off = np.array([list(case.nuisances.sense_v.values()) for case in cases]) / RAIL_V
    assert np.abs(off).max() <= sum(SENSE)
    assert np.std(off.mean(axis=1)) > 0.4 * SENSE[0]
    assert np.std(off - off.mean(axis=1, keepdims=True)) > 0.4 * SENSE[1]


def test_a_case_tells_in_its_key_what_was_read():
    styles = {}
    for seed in range(20):
        draft = LeggedDraft(seed, NULL)
        styles.setdefault(draft.case.volts, draft.told()["style"])
    assert styles == {False: "position", True: "position and voltage"}


def test_a_leg_on_a_stand_reads_none():
    assert not any(draw_legged(s, Asked(kind="null", rig="marvin-leg")).volts for s in range(10))
