"""Recordings with something wrong: a clear word, no wrong cause, no traceback."""

import json
from math import nan

import numpy as np
import pyarrow as pa
import pytest
from diagnosing import busemu, refused, without_most, written
from swinging import ROBOT, swings

from bench.diagnosis.observed import left_out, observe, stuck
from bench.diagnosis.running import DiagnosisError, Split, diagnose
from bench.recording import Recording, write
from busemu.tables import load_robot

CENTRE = 2048


def changed(recording, raw=None, **metadata):
    """A recording with other raw values, or other metadata."""
    table = recording.table
    if raw is not None:
        column = pa.array(raw, pa.float64())
        table = table.set_column(table.column_names.index("raw"), "raw", column)
    return Recording.checked(table, dict(recording.metadata) | metadata)


def columns(recording):
    raw = recording.table["raw"].to_numpy().copy()
    reads = np.array([op == "read" for op in recording.table["op"].to_pylist()])
    return raw, reads


def diagnosed(folder, recordings, *words):
    written(folder / "logs", recordings)
    done = busemu("--robot", ROBOT, "--out", folder / "out", *words, folder / "logs")
    assert "Traceback" not in done.stderr
    return done


@pytest.mark.parametrize(
    ("factor", "says"), [(np.pi / 180.0, "57th of the goals"), (-1.0, "sign is exchanged")]
)
def test_units_and_signs_that_are_mixed_up_are_refused(factor, says, tmp_path):
    recordings = swings(speeds=(3.0,))
    raw, reads = columns(recordings[0])
    raw[reads] = np.round(CENTRE + factor * (raw[reads] - CENTRE))
    done = diagnosed(tmp_path, [changed(recordings[0], raw)])
    refused(done, "swing-0", "servo 1 present_position", says)
    assert not (tmp_path / "out" / "diagnosis.json").exists()


def test_an_arm_of_ten_metres_is_refused(tmp_path):
    (one,) = swings(speeds=(3.0,))
    long = dict(one.metadata["condition"]) | {"payload_at_m": 10.0}
    refused(diagnosed(tmp_path, [changed(one, condition=long)]), "swing-0", "an arm of 10 m")


def test_a_weight_the_servo_cannot_hold_is_refused(tmp_path):
    (one,) = swings(speeds=(3.0,))
    heavy = dict(one.metadata["condition"]) | {"payload_kg": 5.0}
    refused(diagnosed(tmp_path, [changed(one, condition=heavy)]), "swing-0", "stalls at")


def test_shuffled_rows_are_refused(tmp_path):
    (one,) = swings(speeds=(3.0,))
    path = write(one, tmp_path / "swing.csv")
    head, *rows = path.read_text().splitlines()
    order = np.random.default_rng(0).permutation(len(rows))
    path.write_text("\n".join([head, *(rows[k] for k in order)]) + "\n")
    done = busemu("--robot", ROBOT, "--out", tmp_path / "out", path)
    assert "Traceback" not in done.stderr
    refused(done, str(path), "row", "t_s")


@pytest.mark.slow
def test_glitches_and_lost_replies_are_told_and_nothing_else_is_named(tmp_path):
    random = np.random.default_rng(1)
    spoilt = []
    for one in swings():
        raw, reads = columns(one)
        picked = random.choice(np.flatnonzero(reads)[5:-5], 6, replace=False)
        raw[picked[:3]] = nan
        raw[picked[3:]] = 4000
        table = one.table
        replies = table["t_reply_s"].to_numpy().copy()
        replies[picked[:3]] = nan
        column = pa.array(replies, pa.float64())
        table = table.set_column(table.column_names.index("t_reply_s"), "t_reply_s", column)
        spoilt.append(changed(Recording.checked(table, dict(one.metadata)), raw))
    done = diagnosed(tmp_path, spoilt, *without_most())
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert {cause["effect"] for cause in document["causes"]} == {"lost_samples"}
    limits = " ".join(document["limits"])
    assert "without an answer" in limits
    assert "out of line" in limits


def test_a_recording_in_which_the_joint_is_stuck_is_left_out():
    recordings = swings(speeds=(3.0, 5.0))
    raw, reads = columns(recordings[1])
    raw[reads] = CENTRE
    halted = changed(recordings[1], raw)
    robot = load_robot(ROBOT)
    fine, not_moving = observe([recordings[0], halted], robot, "arm")
    assert not stuck(fine)
    assert stuck(not_moving)
    told = left_out([recordings[0], halted], [fine])
    assert "swing-1" in told[0]
    with pytest.raises(DiagnosisError, match="stands still whatever it is told"):
        diagnose(robot, Split((halted,), ()))


def test_what_stands_still_and_is_told_to_is_not_stuck():
    (still,) = observe(swings(speeds=(3.0,), moving=False), load_robot(ROBOT), "arm")
    assert not stuck(still)
