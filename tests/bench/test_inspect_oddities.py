"""Each oddity is found where it was put, and not where nothing is odd."""

from math import pi

import numpy as np
import pytest
from odd_joints import found, joint, recording

from bench.experiments.position_error import position_law
from bench.recording import Oddity, Weight, oddities
from busemu.tables import load_table


def test_nothing_is_odd_about_a_plain_motion():
    assert oddities(recording(joint(), condition={"supply_v": 5.0})).found == ()


def test_every_oddity_says_what_where_why_and_what_to_do():
    columns = joint()
    columns["present_position", "read"][1][40] = 0
    (odd,) = found(columns, "glitches")
    assert isinstance(odd, Oddity)
    assert odd.weight == Weight.WARNING
    assert odd.servo_id == 1
    assert odd.register == "present_position"
    assert odd.t_start_s == pytest.approx(40 * 0.02 + 0.002)
    table = recording(columns).table
    assert table["raw"][odd.rows[0] - 1].as_py() == 0
    assert table["register"][odd.rows[0] - 1].as_py() == "present_position"
    assert odd.why
    assert odd.advice
    assert odd.where(0.0) == f"servo 1 present_position, 0.802 s, row {odd.rows[0]}"


@pytest.mark.parametrize("places", [[40], [40, 41], [40, 90, 91, 200]])
def test_one_or_two_bad_samples_are_glitches(places):
    columns = joint()
    columns["present_position", "read"][1][places] = 4000
    (odd,) = found(columns, "glitches")
    assert odd.count == len(places)


def test_failed_reads_logged_as_a_constant_are_named():
    columns = joint()
    columns["present_position", "read"][1][[30, 80, 130, 180]] = 0
    (odd,) = found(columns, "glitches")
    assert "4 of them exactly 0" in odd.what


def test_a_step_and_a_turn_of_the_encoder_are_no_glitches():
    columns = joint(seconds=4.0)
    times, raw = columns["present_position", "read"]
    columns["present_position", "read"] = times, np.where(times > 2.0, raw + 700, raw)
    assert not found(columns, "glitches")
    turning = np.round(3000 + 20.0 * np.arange(len(times))) % 4096
    columns["present_position", "read"] = times, turning
    assert not found(columns, "glitches")
    (odd,) = found(columns, "wraps")
    assert odd.count == int((np.diff(turning) < 0).sum())


def test_a_joint_that_trembles_about_the_end_of_its_turn_shows_no_glitches():
    columns = joint()
    times, _ = columns["present_position", "read"]
    trembling = np.where(np.arange(len(times)) % 50 == 25, 4095.0, 1.0)
    columns["present_position", "read"] = times, trembling
    assert not found(columns, "glitches")
    columns["present_position", "read"] = times, np.where(trembling == 1.0, 1.0, 2000.0)
    assert found(columns, "glitches")


@pytest.mark.parametrize(("every", "odd"), [(1, True), (5, False)])
def test_a_load_that_was_read_seldom_may_have_come_and_gone_between(every, odd):
    """Read every 20 ms a single leap is no load's; read every 100 ms it may be a step's."""
    columns = joint()
    times, raw = columns["present_pwm", "read"]
    raw[100] = 885
    columns["present_pwm", "read"] = times[::every], raw[::every]
    assert bool(found(columns, "glitches")) is odd


def test_a_saturated_register_is_told_with_its_share():
    columns = joint()
    columns["present_pwm", "read"][1][100:130] = 885
    columns["present_pwm", "read"][1][130:145] = 65536 - 885
    (odd,) = found(columns, "saturated")
    assert odd.count == 45
    assert odd.t_start_s == pytest.approx(100 * 0.02 + 0.003)


def test_a_joint_that_stays_while_goals_move_is_stuck():
    columns = joint()
    columns["present_position", "read"][1][:] = 2048
    (odd,) = found(columns, "stuck")
    assert odd.weight == Weight.SERIOUS


def test_a_register_that_stays_while_the_joint_moves_is_stuck():
    columns = joint()
    columns["present_pwm", "read"][1][:] = 12
    (odd,) = found(columns, "stuck")
    assert (odd.register, odd.weight) == ("present_pwm", Weight.WARNING)


def test_a_joint_at_rest_is_no_motion():
    columns = joint()
    for key in (("goal_position", "write"), ("present_position", "read")):
        columns[key][1][:] = 2048
    (odd,) = found(columns, "no_motion")
    assert odd.weight == Weight.NOTE


@pytest.mark.parametrize(
    ("factor", "says"),
    [(-1.0, "a sign is exchanged"), (180 / pi / 20, "degrees taken"), (pi / 180, "radians taken")],
)
def test_units_and_signs_that_differ_between_goal_and_position_are_found(factor, says):
    columns = joint(noise=0.0)
    shrink = 20.0 if factor > 1 else 1.0
    for key, by in (
        (("goal_position", "write"), 1 / shrink),
        (("present_position", "read"), factor),
    ):
        times, raw = columns[key]
        columns[key] = times, np.round(2048 + (raw - 2048) * by)
    found_there = found(columns, "unit_mix_up")
    assert [says in odd.what for odd in found_there] == [True]


def test_a_held_register_is_told_with_its_pace():
    columns = joint(seconds=20.0)
    times, raw = columns["present_pwm", "read"]
    held = raw[(np.arange(len(raw)) // 7) * 7]
    del columns["present_pwm", "read"]
    rng = np.random.default_rng(2)
    held = rng.permutation(len(held))[(np.arange(len(raw)) // 7) * 7] % 300
    columns["present_current", "read"] = times, held.astype(float)
    (odd,) = found(columns, "held")
    assert "every 140 ms only, read every 20.0 ms" in odd.what


def test_values_in_coarse_steps_are_told_with_the_step():
    columns = joint()
    times, raw = columns["present_position", "read"]
    speed = 50 * np.round(np.gradient(raw) * 2)
    columns["present_velocity", "read"] = times, np.where(speed < 0, speed + 2**32, speed)
    (odd,) = found(columns, "coarse_steps")
    assert odd.register == "present_velocity"
    assert "steps of 50 counts" in odd.what


@pytest.mark.parametrize(
    ("typed", "contradicted"), [(5.0, False), (4.9, False), (7.4, True), (4.5, True), (5.3, True)]
)
def test_a_typed_in_voltage_is_held_against_the_register(typed, contradicted):
    assert (
        bool(found(joint(), "supply_contradicted", condition={"supply_v": typed})) is contradicted
    )


@pytest.mark.parametrize(
    ("typed", "why"),
    [(0, "does not move"), (-5.0, "does not move"), (4.0, "full duty gives +25% torque and speed")],
)
def test_a_typed_in_voltage_of_nothing_has_no_share(typed, why):
    (odd,) = found(joint(), "supply_contradicted", condition={"supply_v": typed})
    assert why in odd.why


def test_a_voltage_that_swings_is_told():
    columns = joint()
    times, raw = columns["present_input_voltage", "read"]
    columns["present_input_voltage", "read"] = times, np.where(np.sin(2 * times) > 0.8, 45, raw)
    (odd,) = found(columns, "supply_swings")
    assert odd.what.startswith("4.5 to 5.1 V about 5.0 V")
    assert np.sin(2 * odd.t_start_s) > 0.8


def test_a_gap_in_reads_is_told_and_a_pause_of_writes_is_none():
    columns = joint()
    for key, (times, raw) in columns.items():
        start_s, stop_s = (2.0, 4.0) if key[1] == "write" else (5.0, 5.3)
        keep = (times < start_s) | (times > stop_s)
        columns[key] = times[keep], raw[keep]
    (odd,) = found(columns, "gaps")
    assert odd.t_start_s == pytest.approx(4.99, abs=0.02)
    assert odd.t_end_s == pytest.approx(5.31, abs=0.02)
    assert not found(columns, "clock_jump")


def test_a_clock_that_jumps_is_no_gap():
    columns = joint()
    for key, (times, raw) in columns.items():
        columns[key] = np.where(times > 1.55, times + 3600.0, times), raw
    (odd,) = found(columns, "clock_jump")
    assert odd.weight == Weight.SERIOUS
    assert "3600.0" in odd.what
    assert not found(columns, "gaps")


def test_uneven_and_repeated_times_are_told():
    columns = joint()
    rng = np.random.default_rng(3)
    for key, (times, raw) in columns.items():
        columns[key] = times + rng.uniform(0.0, 0.019, len(times)), raw
    assert found(columns, "uneven_sampling")
    columns = joint()
    for key, (times, raw) in columns.items():
        columns[key] = np.floor(times / 0.05) * 0.05, raw
    assert found(columns, "repeated_times")


def test_a_short_log_and_an_empty_one_are_told():
    assert found(joint(seconds=0.3), "too_short")
    assert not found(joint(seconds=0.7), "too_short")
    empty = {key: (times[:0], raw[:0]) for key, (times, raw) in joint().items()}
    assert found(empty, "empty")


@pytest.mark.parametrize(
    ("condition", "says"),
    [
        ({"payload_at_m": 100}, "in millimetres, write 0.1"),
        ({"payload_at_m": 10.0, "payload_kg": 0.1}, "an arm of 10 m"),
        ({"payload_kg": 490}, "in grams, write 0.49"),
        ({"payload_kg": 19.0, "payload_at_m": 0.5}, "need 93.2 N m, the servo stalls at 0.52"),
        ({"payload_kg": -0.1}, "no such quantity"),
        ({"payload_kg": "heavy"}, "no such quantity"),
        ({"supply_v": 7400}, "millivolts"),
    ],
)
def test_metadata_that_cannot_be_true_is_serious(condition, says):
    every = found(joint(), "impossible_metadata", condition=condition)
    assert all(odd.weight == Weight.SERIOUS for odd in every)
    assert any(says in f"{odd.what} {odd.advice}" for odd in every)


def test_a_weight_that_the_servo_can_hold_is_not_odd():
    told = {"payload_kg": 0.49, "payload_at_m": 0.1}
    assert not found(joint(), "impossible_metadata", condition=told)


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [("imu/roll_rad", 40.0, "degrees?"), ("mocap/base_z_m", 350.0, "millimetres?")],
)
def test_namespaced_values_in_another_unit_are_found(name, values, says):
    times = np.arange(0.0, 6.0, 0.02)
    columns = joint() | {(name, "read"): (times, np.full(len(times), values))}
    (odd,) = found(columns, "unit_mix_up")
    assert says in odd.what
    columns[name, "read"] = times, np.full(len(times), 0.5)
    assert not found(columns, "unit_mix_up")


def test_lost_replies_are_told_with_their_longest_run():
    columns = joint()
    columns["present_position", "read"][1][[10, 11, 12, 50]] = np.nan
    (odd,) = found(columns, "lost_replies")
    assert "4 of 300 reads" in odd.what
    assert "at most 3 in a row" in odd.what
    assert odd.weight == Weight.WARNING


def test_the_gravest_come_first():
    columns = joint()
    columns["present_position", "read"][1][:] = 2048
    columns["present_pwm", "read"][1][100:145] = 885
    weights = [
        odd.weight for odd in oddities(recording(columns, condition={"payload_kg": 90})).found
    ]
    assert weights == sorted(weights, reverse=True)
    assert weights[0] == Weight.SERIOUS


@pytest.mark.parametrize(("raw", "odd"), [(100, True), (0, False)])
def test_a_register_that_no_model_follows_is_told_where_it_is_not_as_sold(raw, odd):
    columns = joint()
    columns["feedforward_1st_gain", "read"] = np.array([0.1]), np.array([float(raw)])
    of_rows = found(columns, "without_effect")
    assert [o.register for o in of_rows] == ["feedforward_1st_gain"] * odd
    servo = {"1": {"model": "XL330-M288", "registers": {"feedforward_1st_gain": raw}}}
    of_metadata = found(joint(), "without_effect", servo=servo)
    assert [(o.servo_id, o.register) for o in of_metadata] == [(1, "feedforward_1st_gain")] * odd
    assert not odd or "is 100, not 0" in of_rows[0].what


def test_what_is_stored_moves_no_emulated_servo_and_what_is_not_may():
    """Of every table: a register is marked only if no command knows it."""
    for model in ("MX-28(2.0)", "XL330-M288", "XM430-W350", "STS3215"):
        table = load_table(model)
        marked = [register for register in table.registers if register.stored]
        assert marked
        plain = position_law(table, {})
        for register in marked:
            other = register.maximum if register.initial != register.maximum else register.minimum
            assert position_law(table, {register.name: other}) == plain
    gain = {"position_p_gain": 100}
    assert position_law(load_table("XL330-M288"), gain) != position_law(
        load_table("XL330-M288"), {}
    )
