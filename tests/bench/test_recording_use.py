"""What a recording tells: series, joints, oddities, its description."""

from math import nan, pi

import numpy as np
import pytest
from recording_samples import FORMAT, MARVIN, Row, read_row, rows, sample, table, write_row

from bench.recording import (
    Recorder,
    Recording,
    RecordingError,
    describe,
    gaps,
    joint_track,
    oddities,
)
from bench.recording.describe import id_ranges
from hal.access import Access


def test_a_recorder_keeps_accesses_and_observations_in_the_order_of_time():
    recorder = Recorder()
    recorder(Access(2.0, nan, 3, "write", "goal_position", 512.0))
    recorder.observe(1.0, "mocap/base_x_m", 0.25)
    recorder(Access(1.0, 1.5, 3, "read", "present_position", 500))
    taken = recorder.recording({"robot": "marvin"})
    assert len(recorder) == len(taken) == 3
    assert taken.metadata == {"robot": "marvin", "format": FORMAT}
    assert taken.table["register"].to_pylist() == [
        "mocap/base_x_m",
        "present_position",
        "goal_position",
    ]
    assert taken.table["servo_id"].to_pylist() == [0, 3, 3]
    assert taken.observed("mocap/base_x_m").value.tolist() == [0.25]
    assert "t_latch_s" not in taken.table.column_names


def test_a_recorder_goes_on_after_a_recording_was_made():
    recorder = Recorder()
    recorder(write_row(0.0, 1, 512))
    first = recorder.recording(MARVIN)
    recorder(write_row(1.0, 1, 513))
    assert (len(first), len(recorder.recording(MARVIN))) == (1, 2)


def test_latch_times_are_kept_where_an_access_has_one():
    class Latched(Row):
        t_latch_s = 0.125

    taken = Recording.of([write_row(0.0, 1, 512), Latched(0.1, nan, 1, "write", "led", 1)], MARVIN)
    np.testing.assert_array_equal(taken.table["t_latch_s"].to_numpy(), [nan, 0.125])


def test_a_series_leaves_lost_replies_out():
    taken = Recording.of(
        [read_row(0.1, 3, 500), read_row(0.2, 3, nan), read_row(0.3, 3, 502), read_row(0.3, 4, 9)],
        MARVIN,
    )
    times, raw = taken.series(3, "present_position")
    assert times.tolist() == [0.1, 0.3]
    assert raw.tolist() == [500.0, 502.0]
    assert len(taken.series(3, "present_position", "write").value) == 0
    assert len(taken.series(3, "present_load").value) == 0


def test_a_register_that_is_read_and_written_is_one_series_in_the_order_of_time():
    taken = Recording.of(
        [
            write_row(0.1, 3, 1),
            read_row(0.2, 3, 2, "goal_position"),
            write_row(0.3, 3, 3),
            write_row(0.3, 4, 9),
        ],
        MARVIN,
    )
    assert taken.series(3, "goal_position").value.tolist() == [1.0, 2.0, 3.0]
    assert taken.series(3, "goal_position", "write").value.tolist() == [1.0, 3.0]


def test_si_follows_the_control_table():
    taken = Recording.of(
        [
            read_row(0.1, 3, 512 + 256),
            read_row(0.2, 3, 1024 + 100, "present_speed"),
            read_row(0.3, 3, 512 - 256),
            read_row(0.4, 3, 512 + 256),
        ],
        MARVIN,
    )
    quarter_rad = 256 * 300 / 1024 * pi / 180
    positions = taken.si(3, "present_position").value
    assert positions == pytest.approx([quarter_rad, -quarter_rad, quarter_rad])
    assert taken.si(3, "present_speed").value == pytest.approx([-100 * 0.111 * pi / 30])
    with pytest.raises(RecordingError, match="the model of servo 99 is not known: name it"):
        taken.si(99, "present_position")


def test_a_setting_is_the_metadatas_else_the_factorys():
    taken = sample(servo={3: {"model": "XL-320", "registers": {"p_gain": 16}}})
    assert taken.setting(3, "p_gain") == 16
    assert taken.setting(4, "p_gain") == 32
    assert taken.setting(3, "goal_position") is None


def test_joint_tracks_are_in_the_joints_own_angles():
    quarter = read_row(0.1, 3, 512 + 256)
    taken = Recording.of([write_row(0.0, 3, 512), quarter, write_row(0.2, 3, 600)], MARVIN)
    mount = taken.robot.by_id[3]
    track = joint_track(taken, mount.joint)
    servo_rad = 256 * 300 / 1024 * pi / 180
    assert track.joint == "leg1.femur"
    assert track.position_rad == pytest.approx([mount.to_joint(servo_rad)])
    assert track.goal_rad[0] == pytest.approx(mount.to_joint(0.0))
    assert track.error_rad == pytest.approx([-mount.direction * servo_rad])


def test_a_goal_holds_until_the_next_and_there_is_none_before_the_first():
    track = joint_track(sample(), "leg1.coxa").since(10.0)
    goals = track.goal_at(np.array([-0.01, 0.0, 0.019, 0.02, 99.0]))
    assert np.isnan(goals[0])
    assert goals[1] == goals[2] == track.goal_rad[0]
    assert goals[3] == track.goal_rad[1]
    assert goals[4] == track.goal_rad[-1]


def test_joints_need_a_known_robot():
    taken = Recording.of(rows(), {"robot": "unheard-of"})
    with pytest.raises(RecordingError, match="robot 'unheard-of' is not known: name one"):
        joint_track(taken, "leg1.coxa")
    with pytest.raises(
        RecordingError, match=r"no joint 'leg9\.coxa' on the robot: use one of leg1"
    ):
        joint_track(sample(), "leg9.coxa")


def test_lost_replies_and_other_oddities_are_counted():
    odd = [
        read_row(0.0, 3, nan),
        read_row(0.1, 3, 1024),
        write_row(0.2, 3, 7, "present_position"),
        Row(0.3, 0.25, 3, "read", "present_position", 1.0),
        read_row(0.4, 99, 70000, "angle"),
        Row(0.5, 0.5, 0, "read", "mocap/base_x_m", nan),
    ]
    found = oddities(Recording.of(odd, MARVIN))
    assert found.lost_replies == 1
    assert found.out_of_range == 1
    assert found.read_only_written == 1
    assert found.reply_before_instruction == 1
    assert found.unchecked == 1
    assert found.gaps == ()


def test_a_gap_is_an_interval_far_over_the_series_own_rhythm():
    kept = [row for row in rows(cycles=40) if not 10.30 < row.t_s < 10.45]
    (gap, other) = gaps(Recording.of(kept, MARVIN))
    assert {gap.series, other.series} == {3}
    assert gap.length_s == pytest.approx(0.18)
    assert gap.t_start_s == pytest.approx(10.281)


def test_a_lost_reply_and_a_slow_series_are_no_gaps():
    taken = rows(cycles=40)
    taken[10] = read_row(taken[10].t_s, taken[10].servo_id, nan)
    taken += [write_row(t_s, 1, 1, "torque_enable") for t_s in (9.0, 10.0, 11.0, 30.0)]
    assert gaps(Recording.of(taken, MARVIN)) == ()


def test_a_description_tells_rows_servos_rates_losses_and_gaps():
    kept = [row for row in rows(cycles=40) if not 10.30 < row.t_s < 10.45]
    kept[5] = read_row(kept[5].t_s, kept[5].servo_id, nan)
    kept.append(Row(10.9, 10.9, 0, "read", "mocap/base_x_m", 0.1))
    text = describe(Recording.of(kept, MARVIN | {"condition": {"support": "ground"}}))
    for wanted in (
        "sample: marvin, source emulator",
        "rows in 0.900 s",
        "condition: support = ground",
        "servos: 1-3 (XL-320)",
        "lost replies: 1 of",
        "gaps: 2",
        "0.180 s from",
    ):
        assert wanted in text
    position = next(line for line in text.splitlines() if line.startswith("present_position"))
    assert position.split() == ["present_position", "read", "1-3", "96", "50.0", "1"]


def test_an_empty_recording_can_be_described():
    assert "0 rows in 0.000 s" in describe(Recording.of([], {}))


def test_ids_are_written_as_ranges():
    assert id_ranges([1, 2, 3, 5, 9, 10]) == "1-3, 5, 9-10"


def test_a_recording_knows_its_servos_registers_and_span():
    taken = Recording.checked(table(), MARVIN)
    assert taken.servo_ids == (1, 2)
    assert taken.registers == ("goal_position", "present_position")
    assert taken.duration_s == pytest.approx(0.2)
    assert taken.name == "sample"


def test_an_access_that_is_interrupted_is_kept_whole_or_not_at_all():
    """Ctrl-C may come while a row is being added; the rows after it must stay in step."""

    class Interrupted:
        t_s, t_reply_s, servo_id, op, register = 1.0, nan, 2, "write", "torque_enable"

        @property
        def raw(self):
            raise KeyboardInterrupt

    recorder = Recorder()
    recorder(write_row(0.0, 1, 511))
    with pytest.raises(KeyboardInterrupt):
        recorder(Interrupted())
    recorder(write_row(2.0, 3, 513))
    found = recorder.recording(MARVIN).table.select(["t_s", "servo_id", "register", "raw"])
    assert [tuple(row.values()) for row in found.to_pylist()] == [
        (0.0, 1, "goal_position", 511.0),
        (2.0, 3, "goal_position", 513.0),
    ]
