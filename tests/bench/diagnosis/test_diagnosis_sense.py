"""What is looked at before anything is fitted: can numbers be right, what has to be told."""

from math import nan

import numpy as np
import pyarrow as pa
import pytest
from pendulum_logs import raw_access
from swinging import ROBOT, swings

from bench.diagnosis.sense import TOLD, DiagnosisError, check_motion, check_numbers
from bench.recording import Recording, RecordingError
from busemu.tables import load_robot

CENTRE = 2048


@pytest.fixture(scope="module")
def swing():
    (one,) = swings(speeds=(3.0,))
    return one


def rewritten(one, keep=lambda row: True, more=(), **metadata):
    """The rows of a recording that are kept, changed by ``keep``, and more of them."""
    rows = [raw_access(r["t_s"], r["op"], r["register"], r["raw"]) for r in one.table.to_pylist()]
    rows = sorted([*filter(keep, rows), *more], key=lambda row: row.t_s)
    return Recording.of(rows, dict(one.metadata) | metadata)


def volts(raw):
    return [raw_access(0.02 * k + 0.01, "read", "present_input_voltage", raw) for k in range(90)]


def fed_forward():
    return raw_access(0.011, "read", "feedforward_1st_gain", 90.0)


def at(one, supply_v):
    return dict(one.metadata["condition"]) | {"supply_v": supply_v}


def losing(row):
    if row.op == "read" and row.t_s > 1.9:
        row.raw = row.t_reply_s = nan
    return True


def glitching(row):
    if row.op == "read" and 1.0 < row.t_s < 1.01:
        row.raw = 4000.0
    return True


def halting(row):
    if row.op == "read":
        row.raw = float(CENTRE)
    return True


def ticking(row):
    row.t_s = 0.05 * (row.t_s // 0.05)
    return True


SPOILT = {
    "beyond_voltage_limit": lambda one: rewritten(one, more=volts(80.0), condition=at(one, 8.0)),
    "gaps": lambda one: rewritten(one, lambda row: not 1.0 < row.t_s < 1.4),
    "glitches": lambda one: rewritten(one, glitching),
    "lost_replies": lambda one: rewritten(one, losing),
    "repeated_times": lambda one: rewritten(one, ticking),
    "shuffled_rows": lambda one: rewritten(one, **{"import": {"notes": ["unsorted times: two"]}}),
    "stuck": lambda one: rewritten(one, halting),
    "supply_contradicted": lambda one: rewritten(one, more=volts(50.0), condition=at(one, 7.4)),
    "without_effect": lambda one: rewritten(one, more=[fed_forward()]),
}
SAID = {
    "beyond_voltage_limit": "beyond the factory's max_voltage_limit",
    "gaps": "1 gap",
    "glitches": "out of line",
    "lost_replies": "without an answer",
    "repeated_times": "carry the time of the one before",
    "shuffled_rows": "unsorted times",
    "stuck": "stays at",
    "supply_contradicted": "says 7.4 V, the register 5.0 V",
    "without_effect": "it is 90, not 0 as from the factory",
}


@pytest.mark.parametrize("kind", sorted(TOLD))
def test_what_is_odd_but_bearable_is_told_once_a_kind(swing, kind):
    spoilt = SPOILT[kind](swing)
    (alone,) = check_numbers([spoilt])
    assert alone.startswith("swing-0, ")
    assert SAID[kind] in alone
    (both,) = check_numbers([spoilt, swing, spoilt])
    assert both == f"{alone}; and 1 more like it"


def test_nothing_is_told_of_what_is_not_odd(swing):
    decided = rewritten(swing, **{"import": {"notes": ["goals are taken for written"]}})
    assert check_numbers([swing, decided]) == ()


def test_what_cannot_be_right_is_refused_with_what_to_do(swing):
    heavy = rewritten(swing, condition={"payload_kg": 490.0, "payload_at_m": 0.1})
    with pytest.raises(RecordingError, match=r"490 kg; if it is in grams.*busemu inspect shows"):
        check_numbers([swing, heavy])


def test_a_joint_that_stood_at_several_places_has_moved(swing):
    robot = load_robot(ROBOT)
    still = rewritten(swing, halting)
    raw = still.table["raw"].to_numpy() + np.where(
        np.array(still.table["op"].to_pylist()) == "read", 100.0, 0.0
    )
    column = pa.array(raw, pa.float64())
    table = still.table.set_column(still.table.column_names.index("raw"), "raw", column)
    elsewhere = Recording.checked(table, dict(still.metadata))
    check_motion([still, elsewhere], robot)
    for recordings in ([still], [still, still]):
        with pytest.raises(DiagnosisError, match=f"never changes in {len(recordings)} recording"):
            check_motion(recordings, robot)
