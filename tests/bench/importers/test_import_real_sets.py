"""The recordings of other people, read in place: every file, every row, every number."""

import ast
import csv
import gzip
import json
from functools import cache

import numpy as np
import pytest
from foreign_logs import STEP_RAD, recordings

from bench.importers import import_file
from bench.importers.opening import expanded
from bench.recording import Weight, oddities


def rows_of(path):
    data = path.read_bytes()
    text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode()
    return list(csv.DictReader(text.splitlines()))


def column(rows, name):
    return np.array([float(row[name]) if row[name] else np.nan for row in rows])


@cache
def imported(path):
    (recording,) = import_file(path)
    return recording


def kinds(recording, least=Weight.WARNING):
    return {odd.kind for odd in oddities(recording).found if odd.weight >= least}


@pytest.mark.parametrize("folder", ["bam-xl330", "binhpham-xl330"])
def test_every_pendulum_log_imports_row_by_row_and_value_by_value(folder):
    paths = expanded([recordings(folder)])
    assert len(paths) == 8
    for path in paths:
        log = json.loads(path.read_text())
        entries, recording = log["entries"], imported(path)
        position = recording.si(1, "present_position", "read")
        assert len(position.value) == len(entries)
        wanted = [e["position"] for e in entries]
        assert np.abs(position.value - wanted).max() <= STEP_RAD / 2
        on = [e for e in entries if e["torque_enable"]]
        goals = recording.si(1, "goal_position", "write").value
        assert np.abs(goals - [e["goal_position"] for e in on]).max() <= STEP_RAD / 2 + 1e-12
        volts = recording.si(1, "present_input_voltage").value
        assert volts == pytest.approx([e["input_volts"] for e in entries])
        speed = recording.si(1, "present_velocity").value
        assert speed == pytest.approx([e["speed"] for e in entries], abs=1e-9)
        load = [e["load"] & 0xFFFF for e in entries]
        register = "present_pwm" if folder == "bam-xl330" else "present_current"
        assert recording.series(1, register).value.tolist() == load
        assert recording.setting(1, "position_p_gain") == log["kp"]
        assert recording.metadata["condition"]["payload_kg"] == log["mass"]
        off = recording.series(1, "torque_enable", "write").value.tolist()
        assert off == ([0.0] if log["trajectory"] == "lift_and_drop" else [])
        # the middle of the reads is the sample's time
        middle = position.t_sample_s[0] + recording.series(1, "present_temperature").t_sample_s[0]
        fifth = recording.table["t_reply_s"].to_numpy()[recording.rows(1, "present_position")[0]]
        fifth -= position.t_sample_s[0]
        assert middle / 2 + fifth / 2 == pytest.approx(entries[0]["timestamp"], abs=1e-6)


def test_the_recorders_loop_is_found_alike_in_every_log():
    """Goals lead their samples by the same time in all logs of a rig, whatever the motion."""
    for folder, lead_s, spread_s in (
        ("bam-xl330", 3.55e-3, 0.1e-3),
        ("binhpham-xl330", 21.0e-3, 0.4e-3),
    ):
        for path in expanded([recordings(folder)]):
            goal = imported(path).series(1, "goal_position", "write").t_sample_s[0]
            stamp = json.loads(path.read_text())["entries"][0]["timestamp"]
            assert stamp - goal == pytest.approx(lead_s, abs=spread_s), path.name


def test_every_motion_of_the_arm_imports_row_by_row_and_value_by_value():
    paths = expanded([recordings("sage-so101")])
    assert len(paths) == 37
    for path in paths[::6]:
        state = rows_of(path)
        control = rows_of(path.with_name("control.csv.gz"))
        recording = imported(path)
        goals = np.array([ast.literal_eval(row["positions"]) for row in control])
        positions = np.array([ast.literal_eval(row["positions"]) for row in state])
        assert len(recording) == 6 * len(control) + 18 * len(state)
        for servo in range(1, 7):
            logged = recording.metadata["servo"][str(servo)]["logged"]
            zero, scale = logged["zero_count"], logged["counts_a_unit"]
            for register, op, wanted, most in (
                ("goal_position", "write", goals, 0.5),
                ("present_position", "read", positions, 0.02),
            ):
                raw = recording.series(servo, register, op)
                assert len(raw.value) == len(wanted)
                assert (
                    np.abs((raw.value - zero) - wanted[:, servo - 1] * scale).max() <= most + 1e-9
                )
        assert recording.robot.name == "so101"


def test_every_motion_of_the_arm_is_known_and_repeats_share_a_group():
    groups = {}
    for path in expanded([recordings("sage-so101")]):
        groups.setdefault(imported(path).metadata["group"], []).append(path)
    assert len(groups) == 30
    assert sum(len(paths) == 2 for paths in groups.values()) == 7


def test_the_earlier_session_of_the_arm_logged_register_counts():
    """Its velocities and currents are whole numbers; as rad/s the arm would turn at 100 rad/s."""
    for session, whole in (("main", False), ("run_1", True)):
        recording = imported(recordings("sage-so101", session, "chirp_sweep", "state_motor.csv.gz"))
        told = " ".join(recording.metadata["import"]["notes"])
        assert ("taken for register counts" in told) is whole
        position, speed = (recording.si(1, f"present_{what}") for what in ("position", "speed"))
        span = speed.value[position.t_sample_s > 100.0]
        moved = np.gradient(position.value, position.t_sample_s)[position.t_sample_s > 100.0]
        assert np.polyfit(moved, span, 1)[0] == pytest.approx(1.0, abs=0.15)


def test_every_file_of_the_mx64_imports_row_by_row_and_value_by_value():
    paths = expanded([recordings("dynaban-mx64")])
    listed = rows_of(recordings("dynaban-mx64", "manifest.csv"))
    assert len(paths) == len(listed) == 204
    for path in paths:
        rows, recording = rows_of(path), imported(path)
        names = rows[0].keys()
        for name, register in (
            ("position_steps_4096", "present_position"),
            ("position_steps", "present_position"),
            ("speed_reg", "present_speed"),
            ("current_reg", "current"),
            ("load_reg", "present_load"),
        ):
            if name in names:
                key = (register, "read") if path.stem != "ideal" else ("goal_position", "write")
                raw = recording.series(1, *key).value
                assert raw.tolist() == column(rows, name).tolist()
        if "pwm_command_of_3000" in names:
            duty = recording.observed("foreign/goal_duty").value * 3000.0
            assert duty == pytest.approx(column(rows, "pwm_command_of_3000"))
        if "reg36" in names:
            raw = recording.series(1, "present_position").value
            assert (raw % 256).tolist() == column(rows, "reg36").tolist()
        assert recording.duration_s == pytest.approx(
            np.ptp(column(rows, next(iter(names)))) * (1e-6 if "time_us" in names else 1e-4)
        )


def test_set_points_of_the_mx64_fit_the_direction_it_turns_in():
    folder = recordings("dynaban-mx64", "stock_firmware", "velocity_constant")
    for path in sorted(folder.glob("*VitesseCte*rpmX100.csv")):
        recording = imported(path)
        wanted = recording.si(1, "moving_speed", "write").value[-1]
        steps = np.diff(recording.series(1, "present_position").value)
        turned = np.median(
            steps[np.abs(steps) > 0] - 4096 * np.round(steps[np.abs(steps) > 0] / 4096)
        )
        assert np.sign(turned) == np.sign(wanted), path.name


def test_every_telemetry_log_imports_row_by_row_and_value_by_value():
    paths = expanded([recordings("robonine-sts3215-backlash")])
    assert len(paths) == 3
    for path in paths:
        rows, recording = rows_of(path), imported(path)
        for name in rows[0]:
            if name.startswith("pos ("):
                servo, wanted = int(name[5:-1]), column(rows, name)
                assert len(recording.rows(servo, "present_position")) == len(rows)
                raw = recording.series(servo, "present_position").value
                assert raw.tolist() == wanted[~np.isnan(wanted)].tolist()
                targets = column(rows, f"target pos ({servo})")
                writes = recording.series(servo, "goal_position", "write")
                times = np.unique(recording.t_s)
                held = np.searchsorted(writes.t_sample_s, times, side="right") - 1
                assert writes.value[held].tolist() == targets.tolist()


def test_what_the_descriptions_of_the_sets_tell_is_found():
    # the typed-in 5.0 V of the light arm are 5.2 V at the servo
    for path in expanded([recordings("binhpham-xl330")]):
        assert "supply_contradicted" in kinds(imported(path))
    # the heavy pendulum's supply swings, above the servo's own limit
    swings = [
        path
        for path in expanded([recordings("bam-xl330")])
        if "supply_swings" in kinds(imported(path))
    ]
    assert len(swings) == 7
    # Feetech speeds come in steps of 50 counts
    arm = imported(recordings("sage-so101", "main", "chirp_sweep", "state_motor.csv.gz"))
    assert "coarse_steps" in kinds(arm, Weight.NOTE)
    # single temperatures 30 K above their neighbours
    bands = imported(recordings("robonine-sts3215-backlash", "logs", "motor_telemetry_comp2.csv"))
    hot = [o for o in oddities(bands).found if o.kind == "glitches"]
    assert {(o.servo_id, o.register) for o in hot} >= {
        (1, "present_temperature"),
        (2, "present_temperature"),
    }


def test_single_bad_reads_of_the_mx64_are_found_where_they_are():
    folder = recordings("dynaban-mx64", "stock_firmware", "velocity_constant")
    recording = imported(next(folder.glob("*09h_00mn_49s*")))
    (bad,) = [
        o
        for o in oddities(recording).found
        if o.kind == "glitches" and o.register == "present_position"
    ]
    row = bad.rows[0] - 1
    raw = recording.table["raw"].to_numpy()
    around = recording.rows(1, "present_position")
    place = int(np.searchsorted(around, row))
    assert raw[row] == 2048
    assert abs(raw[around[place - 1]] - raw[around[place + 1]]) < 5
    assert abs(raw[row] - raw[around[place - 1]]) > 500
