"""Each shape of foreign file becomes raw values on the wire, and says what had to be decided."""

import json
from math import isnan, pi

import numpy as np
import pytest
from foreign_logs import (
    MAKERS,
    STEP_RAD,
    WIDE_MAP,
    bam_entries,
    bam_log,
    dump,
    duty_log,
    lines,
    pair,
    register_log,
    same,
    telemetry,
    wide,
)

from bench.diagnosis.observed import observe
from bench.importers import FORMATS, import_file, open_recordings, recognise
from bench.importers.bam import MOTORS
from bench.recording import RecordingError, joint_track, write
from bench.recording.columns import numbers
from bench.recording_commands import import_


def notes(recording):
    return " ".join(recording.metadata["import"].get("notes", []))


@pytest.mark.parametrize("name", MAKERS)
def test_a_format_is_told_by_the_shape_of_a_file_not_by_its_name(tmp_path, name):
    path = MAKERS[name](tmp_path)
    wanted = {"dump": "dynaban", "duty": "dynaban"}.get(name, name)
    assert recognise(path).name == wanted
    (recording,) = import_file(path)
    assert recording.metadata["import"]["format"] == wanted
    assert recording.metadata["source"] == "real"


def test_bam_loads_are_two_complement_and_goals_come_before_their_reads(tmp_path):
    (recording,) = import_file(bam_log(tmp_path / "log.json"))
    entries = bam_entries()
    assert recording.robot.name == "xl330-pendulum"
    condition = recording.metadata["condition"]
    assert (condition["payload_kg"], condition["payload_at_m"], condition["supply_v"]) == (
        0.49,
        0.1,
        7.4,
    )
    assert recording.setting(1, "position_p_gain") == 400
    assert recording.series(1, "present_pwm").value.tolist() == [e["load"] for e in entries]
    goals, reads = (
        recording.si(1, "goal_position", "write"),
        recording.si(1, "present_position", "read"),
    )
    assert np.abs(goals.value - [e["goal_position"] for e in entries]).max() <= STEP_RAD / 2 + 1e-9
    assert reads.value == pytest.approx([e["position"] for e in entries])
    stamps = np.array([e["timestamp"] for e in entries])
    assert stamps - goals.t_sample_s == pytest.approx(0.003, abs=1e-4)
    # what is left of the loop's 5 ms after goal and half of the reads is the other half
    assert stamps - reads.t_sample_s == pytest.approx(0.002, abs=1e-4)
    assert "goals 3.0" in notes(recording)


@pytest.mark.parametrize("motor", MOTORS)
def test_every_motor_of_a_bam_log_has_a_rig_of_its_own(tmp_path, motor):
    path = bam_log(tmp_path / "log.json")
    document = json.loads(path.read_text())
    entries = [entry | {"load": 0} for entry in document["entries"]]
    path.write_text(json.dumps(document | {"motor": motor, "kp": 8, "entries": entries}))
    (recording,) = import_file(path)
    assert recording.robot.name == f"{motor}-pendulum"
    assert recording.robot.by_id[1].model == MOTORS[motor]
    (seen,) = observe([recording], recording.robot, "arm")
    reads = recording.si(1, "present_position", "read")
    assert seen.position.value == pytest.approx(reads.value)


def test_bam_torque_off_is_a_write_and_no_goals_come_after_it(tmp_path):
    log = bam_log(tmp_path / "log.json", bam_entries(off_from=120))
    (recording,) = import_file(log)
    off = recording.series(1, "torque_enable", "write")
    assert off.value.tolist() == [0.0]
    goals = recording.series(1, "goal_position", "write")
    assert len(goals.value) == 120
    assert goals.t_sample_s.max() < off.t_sample_s[0]
    assert recording.setting(1, "torque_enable") == 1
    assert len(recording.series(1, "present_position").value) == 200


def test_bam_load_that_contradicts_the_controllers_law_is_no_duty(tmp_path):
    entries = bam_entries()
    for entry in entries:
        entry["load"] = -12
    (recording,) = import_file(bam_log(tmp_path / "log.json", entries))
    assert "present_pwm" not in recording.registers
    assert set(recording.series(1, "present_current").value) == {65536.0 - 12.0}
    assert "load is not the duty" in notes(recording)


def test_bam_repeats_share_a_group_and_other_gains_do_not(tmp_path):
    groups = [
        import_file(bam_log(tmp_path / f"{i}.json", kp=kp))[0].metadata["group"]
        for i, kp in enumerate((400, 400, 100))
    ]
    assert groups[0] == groups[1] != groups[2]


@pytest.mark.parametrize("packed", [True, False])
def test_a_pair_becomes_one_recording_whichever_file_is_named(tmp_path, packed):
    control = pair(tmp_path / "motion", packed=packed)
    state = control.with_name(control.name.replace("control", "state_motor"))
    (one,) = open_recordings([control, state])
    (other,) = import_file(state)
    assert same(one, other)
    assert one.servo_ids == (1, 2, 3)
    assert one.metadata["group"] == "motion"
    assert len(one) == 40 * 3 * 4


@pytest.mark.parametrize(("half", "zero"), [(0.0, 2048.0), (0.5, 2047.5)])
def test_positions_become_the_counts_they_were_made_of(tmp_path, half, zero):
    (recording,) = import_file(pair(tmp_path / "motion", half=half))
    logged = recording.metadata["servo"]["1"]["logged"]
    assert logged["zero_count"] == zero
    raw = recording.series(1, "present_position").value
    assert raw.tolist() == [zero + i + half for i in range(40)]
    goals = recording.series(1, "goal_position", "write").value
    assert np.abs(goals - zero - 0.001 * np.arange(40) / STEP_RAD).max() <= 0.5
    jaw = recording.series(3, "present_position").value
    assert jaw.tolist() == [2048 + 600 + i for i in range(40)]


@pytest.mark.parametrize(("scale", "told"), [(STEP_RAD, False), (1, True)])
def test_velocities_are_told_from_register_counts_by_being_whole(tmp_path, scale, told):
    (recording,) = import_file(pair(tmp_path / "motion", scale=scale))
    assert set(recording.series(1, "present_speed").value) == {50.0}
    assert set(recording.series(2, "present_speed").value) == {32768.0 + 100.0}
    assert ("taken for register counts" in notes(recording)) is told
    assert set(recording.series(3, "present_current").value) == {2.0}


def test_a_pair_without_its_other_half_says_which_file_is_missing(tmp_path):
    control = pair(tmp_path / "motion")
    control.with_name("state_motor.csv.gz").unlink()
    with pytest.raises(RecordingError, match=r"state_motor\.csv\(\.gz\) is missing beside it"):
        import_file(control)


def test_a_duty_that_no_register_holds_is_kept_under_a_namespace(tmp_path):
    (recording,) = import_file(duty_log(tmp_path / "gearbox_only" / "type0_test00.csv"))
    assert set(recording.observed("foreign/goal_duty").value) == {-0.5}
    assert recording.series(1, "present_position").value[:8].tolist() == [
        4090, 4091, 4092, 4093, 4094, 4095, 0, 1,
    ]  # fmt: skip
    assert recording.series(1, "present_position").t_sample_s[1] == pytest.approx(1e-3)
    assert recording.observed("foreign/velocity_rad_s").value[1] == pytest.approx(20 * STEP_RAD)
    assert recording.metadata["condition"]["load"] == "gearbox_only"


@pytest.mark.parametrize(
    ("name", "register", "raw"),
    [
        ("test_VitesseCte2000rpmX100.csv", "moving_speed", 1024 + 175),
        ("test_CoupleCte2000mA.csv", "goal_torque", 1024 + 444),
        ("Experience10Rpm.csv", "goal_position", round(2000 * 4096 / 360)),
    ],
)
def test_set_points_are_what_the_name_of_the_file_says(tmp_path, name, register, raw):
    (recording,) = import_file(register_log(tmp_path / name))
    assert recording.series(1, register, "write").value.tolist() == [raw]
    assert recording.series(1, "current").value[:2].tolist() == [2048, 2047]
    assert recording.si(1, "present_speed").value[0] == pytest.approx(-20 * 0.114 * pi / 30)


def test_set_points_of_unknown_meaning_are_kept_apart(tmp_path):
    (recording,) = import_file(register_log(tmp_path / "strange.csv"))
    assert set(recording.observed("foreign/setpoint").value) == {2000.0}


def test_bytes_become_registers_through_the_control_table(tmp_path):
    (recording,) = import_file(dump(tmp_path / "hold_Kp8.csv", rows=100))
    position = recording.series(1, "present_position").value
    assert position[0] == 1200.0
    assert position[79] == 4 * 256 + 255
    assert recording.setting(1, "goal_position") == 1201
    assert recording.setting(1, "torque_limit") == 1023
    assert recording.setting(1, "p_gain") == 8
    assert set(recording.observed("foreign/register_53").value) == {9.0}


def test_a_reference_is_taken_for_goals(tmp_path):
    path = lines(tmp_path / "ideal.csv", "time_0.1ms,position_steps_4096", "10,0", "20,1", "30,2")
    (recording,) = import_file(path)
    assert recording.series(1, "goal_position", "write").value.tolist() == [0, 1, 2]
    assert "reference" in notes(recording)


def test_the_weight_in_a_files_name_is_the_payload(tmp_path):
    path = lines(
        tmp_path / "pid_only_270g_12cm_45degrees.csv",
        "time_0.1ms,position_steps_4096",
        "9,0",
        "19,0",
    )
    condition = import_file(path)[0].metadata["condition"]
    assert condition["payload_kg"] == pytest.approx(0.27)
    assert condition["payload_at_m"] == pytest.approx(0.12)


def test_telemetry_targets_are_writes_where_they_change_and_empty_cells_lost_replies(tmp_path):
    (recording,) = import_file(telemetry(tmp_path / "telemetry.csv"))
    assert recording.series(5, "goal_position", "write").value.tolist() == [1947, 2047]
    rows = recording.rows(5, "present_position", "read")
    assert len(rows) == 41
    assert isnan(numbers(recording.table, "raw")[rows[0]])
    assert isnan(numbers(recording.table, "t_reply_s")[rows[0]])
    assert recording.si(5, "present_speed").value[0] == pytest.approx(-50 * STEP_RAD)
    assert recording.si(5, "present_load").value[0] == pytest.approx(-0.04)
    assert recording.robot.name == "sts3215-lever"


def test_a_map_says_joint_unit_sign_offset_and_time_of_each_column(tmp_path):
    (recording,) = import_file(wide(tmp_path / "wide.csv"))
    track = joint_track(recording, "leg1.femur")
    half = recording.register(3, "goal_position").si_scale / 2
    assert (
        np.abs(np.degrees(track.goal_rad) - (30 + np.arange(40) / 10)).max()
        <= np.degrees(half) + 1e-6
    )
    assert np.abs(track.position_rad - track.goal_rad).max() <= 2 * half
    assert track.position_t_s[1] == pytest.approx(0.022)
    load = recording.si(3, "present_load").value
    assert np.abs(load - (11 - np.arange(40) / 10) / 100).max() <= 0.5 * 0.000977517 + 1e-9
    assert recording.observed("imu/roll_rad").value == pytest.approx(np.radians(np.arange(40)))
    assert "columns without an entry in the map: unused" in notes(recording)
    assert recording.metadata["group"] == "steps"


def test_on_change_writes_only_what_changes(tmp_path):
    text = WIDE_MAP.replace(
        'unit = "deg"\n[[column]]\nname = "femur"',
        'unit = "deg"\non_change = true\n[[column]]\nname = "femur"',
    )
    path = wide(tmp_path / "wide.csv", text=text)
    lines(path, "t,femur goal,femur,load,roll", "0,30,0.5,0,0", "20,30,0.5,0,0", "40,31,0.5,0,0")
    (recording,) = import_file(path)
    assert recording.series(3, "goal_position", "write").t_sample_s.tolist() == [0.0, 0.04]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("busemu-columns/1", "other/1", 'needs the line format = "busemu-columns/1"'),
        ('joint = "leg1.femur"', 'joint = "leg9.femur"', "'leg9.femur' is on no robot"),
        ('unit = "percent"', 'unit = "V"', "present_load is in no unit, which V is not"),
        ('unit = "percent"', 'unit = "stone"', "unit 'stone' is not one of"),
        ("present_load", "present_mood", "XL-320 has no register 'present_mood'"),
        ('name = "load"', 'name = "lode"', "column lode is missing"),
        ("servo = 3", "wheel = 3", "unknown key 'wheel'"),
        ("servo = 3\n", "", "needs servo or joint"),
        ("sign = -1", "sign = 2", "sign must be 1 or -1"),
        ('unit = "ms"', 'unit = "h"', "is not one of s, ms, us"),
        ('robot = "marvin"', 'robot = "nobody"', "robot 'nobody' is not known"),
    ],
)
def test_a_wrong_map_is_refused_with_the_column_and_the_rule(tmp_path, old, new, says):
    assert old in WIDE_MAP
    path = wide(tmp_path / "wide.csv", text=WIDE_MAP.replace(old, new))
    with pytest.raises(RecordingError, match=r"\w") as caught:
        import_file(path)
    assert says in str(caught.value)


def test_goals_beyond_their_register_are_refused_with_the_row(tmp_path):
    path = wide(tmp_path / "wide.csv")
    path.write_text("t,femur goal,femur,load,roll\n0,30,0.5,0,0\n20,90000,0.5,0,0\n")
    with pytest.raises(RecordingError, match=r"row 2 .*femur goal is .* cannot hold"):
        import_file(path)


def test_shuffled_rows_are_sorted_and_told(tmp_path):
    entries = bam_entries()
    entries[10], entries[50] = entries[50], entries[10]
    (recording,) = import_file(bam_log(tmp_path / "log.json", entries))
    assert (np.diff(recording.t_s) >= 0.0).all()
    assert "unsorted times" in notes(recording)


def test_own_recordings_and_foreign_logs_open_alike(tmp_path):
    (recording,) = import_file(bam_log(tmp_path / "log.json"))
    write(recording, tmp_path / "own.parquet")
    write(recording, tmp_path / "own.csv")
    found = open_recordings([tmp_path])
    assert sorted(r.path.name for r in found) == ["log.json", "own.csv", "own.parquet"]
    assert all(same(r, recording) for r in found)


def test_a_robot_can_be_named_for_a_foreign_log(tmp_path):
    path = bam_log(tmp_path / "log.json")
    (recording,) = import_file(path, robot="mx64-bench")
    assert recording.robot.name == "mx64-bench"
    assert recording.models[1].model == "XL330-M288"


def test_a_folder_without_recordings_and_a_file_of_no_format_say_so(tmp_path):
    lines(tmp_path / "notes.csv", "a,b", "1,2")
    with pytest.raises(RecordingError, match="no recordings in this folder"):
        open_recordings([tmp_path])
    with pytest.raises(RecordingError, match="none of the known formats"):
        open_recordings([tmp_path / "notes.csv"])
    with pytest.raises(RecordingError, match="no format 'word': use auto or one of bam"):
        import_file(tmp_path / "notes.csv", "word")


def test_the_formats_are_those_that_the_help_names():
    assert set(FORMATS) == {"bam", "so101", "dynaban", "telemetry", "wide-csv"}
    assert all(name in import_.__doc__ for name in FORMATS)
