"""Where an oddity begins: the same thing told, and not told where it is too little to matter."""

import numpy as np
import pytest
from odd_joints import found, joint, recording

from bench.recording import Recording, Weight, oddities

DUTY = ("present_pwm", "read")
GOAL = ("goal_position", "write")
POSITION = ("present_position", "read")
VOLTS = ("present_input_voltage", "read")
HEAT = ("present_temperature", "read")


def with_values(key, values, columns=None):
    """A joint of which one register is read as ``values``, or ``values`` of the time [s]."""
    columns = joint() if columns is None else columns
    times, _ = columns[POSITION]
    raw = values(times) if callable(values) else np.broadcast_to(values, times.shape)
    return columns | {key: (times + 0.005, raw.astype(float))}


def spiked(key, value, *places, columns=None):
    columns = joint() if columns is None else columns
    columns[key][1][list(places)] = value
    return columns


# -- accesses


@pytest.mark.parametrize(("lost", "weight"), [(3, Weight.NOTE), (4, Weight.WARNING)])
def test_lost_replies_weigh_more_from_one_in_a_hundred_on(lost, weight):
    (odd,) = found(spiked(POSITION, np.nan, *range(0, 20 * lost, 20)), "lost_replies")
    assert odd.weight == weight


def test_one_lost_reply_of_a_register_that_is_seldom_read_is_no_warning():
    seldom = joint() | {POSITION: tuple(column[::20] for column in joint()[POSITION])}
    for lost, weight in (((3,), Weight.NOTE), ((3, 9), Weight.WARNING)):
        (odd,) = found(spiked(POSITION, np.nan, *lost, columns=seldom), "lost_replies")
        assert odd.weight == weight


def test_writes_to_what_only_the_servo_changes_are_told():
    columns = joint() | {("present_temperature", "write"): (np.array([1.0, 2.0]), np.full(2, 30.0))}
    (odd,) = found(columns, "read_only_written")
    assert odd.what.startswith("2 writes")
    assert not found(joint(), "read_only_written")


@pytest.mark.parametrize(("duty", "outside"), [(885, False), (886, True)])
def test_values_that_no_servo_of_the_model_sends_are_told(duty, outside):
    columns = spiked(DUTY, duty, *range(100, 120))
    assert bool(found(columns, "out_of_range")) is outside


@pytest.mark.parametrize(("count", "outside"), [(4095, False), (4096, True)])
def test_a_position_beyond_the_last_of_a_turn_is_out_of_range(count, outside):
    t = np.arange(0.0, 6.0, 0.02)
    columns = {POSITION: (t, np.where(t < 5.0, np.round(4000 + 90 * np.sin(t)), count))}
    assert bool(found(columns, "out_of_range", robot="mx64-bench")) is outside


def test_servos_nobody_knows_and_servos_of_no_robot_are_told():
    (odd,) = found(joint(), "unknown_model", robot="no-such-robot")
    assert odd.servo_id == 1
    (odd,) = found(joint(), "no_robot", robot="no-such-robot")
    assert "'no-such-robot' is not known here" in odd.what
    assert not found(joint(), "not_on_robot")
    strange = {"robot": "XL330-M288:2-3", "servo": {"1": {"model": "XL330-M288"}}}
    (odd,) = found(joint(), "not_on_robot", **strange)
    assert odd.servo_id == 1


def test_replies_before_their_instruction_are_told():
    whole = recording(joint())
    replies = whole.table["t_reply_s"].to_numpy().copy()
    row = int(np.flatnonzero(~np.isnan(replies))[5])
    replies[row] -= 1.0
    at = whole.table.column_names.index("t_reply_s")
    table = whole.table.set_column(at, "t_reply_s", [replies])
    found_there = oddities(Recording.checked(table, dict(whole.metadata))).found
    (odd,) = [o for o in found_there if o.kind == "reply_before_instruction"]
    assert odd.rows == (row + 1,)
    assert not found(joint(), "reply_before_instruction")


# -- signals


@pytest.mark.parametrize(("duty", "glitch"), [(300, False), (700, True)])
def test_a_duty_may_leap_by_a_fifth_of_its_range(duty, glitch):
    assert bool(found(spiked(DUTY, duty, 100), "glitches")) is glitch


def test_a_register_that_leaps_every_now_and_then_does_so_in_earnest():
    every = 28.0 + 20.0 * (np.arange(300) % 20 == 7)
    assert not found(with_values(HEAT, every), "glitches")
    once = 28.0 + 20.0 * (np.arange(300) == 107)
    (odd,) = found(with_values(HEAT, once), "glitches")
    assert odd.count == 1


@pytest.mark.parametrize(("off", "glitch"), [(120, False), (900, True)])
def test_a_glitch_stands_out_of_the_noise(off, glitch):
    columns = joint(noise=8.0)
    columns[POSITION][1][100] += off
    assert bool(found(columns, "glitches")) is glitch


def test_two_bad_samples_of_one_value_are_no_failed_reads_yet():
    (odd,) = found(spiked(POSITION, 0, 30, 200), "glitches")
    assert "exactly" not in odd.what


def test_a_glitch_is_no_turn_of_the_encoder():
    columns = joint()
    columns[POSITION][1][:] += 900
    assert found(spiked(POSITION, 300, 100, columns=columns), "glitches")
    assert not found(columns, "wraps")


@pytest.mark.parametrize(("reads", "told"), [(20, False), (40, True)])
def test_a_register_that_was_hardly_read_is_not_stuck(reads, told):
    columns = joint()
    times, _ = columns[DUTY]
    columns[DUTY] = times[:reads], np.full(reads, 12.0)
    assert bool(found(columns, "stuck")) is told


def test_a_register_of_a_joint_at_rest_is_not_stuck():
    columns = spiked(DUTY, 12, *range(300))
    columns[POSITION][1][:] = columns[GOAL][1][:] = 2048
    assert not found(columns, "stuck")


def test_units_are_not_judged_by_noise_or_by_a_goal_that_trembles():
    columns = joint()
    times, goal = columns[GOAL]
    random = np.random.default_rng(4)
    against = 2048 - (goal - 2048) + random.normal(0.0, 300.0, len(goal))
    columns[POSITION] = columns[POSITION][0], np.round(against)
    assert not found(columns, "unit_mix_up")
    tremble = np.round(np.sin(2 * times))
    columns[GOAL] = times, 2048 + tremble
    columns[POSITION] = times + 0.002, 2048 + 57 * tremble
    assert not found(columns, "unit_mix_up")


# -- voltages and heat


def half_and_half(low, high):
    return lambda t: np.where(np.arange(len(t)) % 5 < 2, low, high)


@pytest.mark.parametrize(("volts", "told"), [(5.0, False), (6.0, False), (4.7, True), (6.3, True)])
def test_a_typed_in_voltage_within_the_usual_swing_is_not_contradicted(volts, told):
    columns = with_values(VOLTS, half_and_half(50, 60))
    assert bool(found(columns, "supply_contradicted", condition={"supply_v": volts})) is told


@pytest.mark.parametrize(("raw", "told"), [(122, False), (124, True)])
def test_a_high_voltage_is_contradicted_by_its_share(raw, told):
    columns = with_values(VOLTS, raw)
    assert bool(found(columns, "supply_contradicted", condition={"supply_v": 12.0})) is told


def test_the_robots_file_is_held_against_the_register_where_nothing_was_typed_in():
    (odd,) = found(with_values(VOLTS, 74), "supply_contradicted")
    assert odd.what == "the robot's file says 5 V, the register 7.4 V (median)"


@pytest.mark.parametrize(("high", "told"), [(52, False), (54, True)])
def test_a_voltage_that_moves_by_some_counts_does_not_swing(high, told):
    assert bool(found(with_values(VOLTS, half_and_half(49, high)), "supply_swings")) is told


@pytest.mark.parametrize(("other", "rises"), [(60, True), (40, False)])
def test_a_supply_that_takes_no_current_is_told_from_one_that_sags(other, rises):
    swings = with_values(VOLTS, lambda t: np.where(np.sin(2 * t) > 0.8, other, 50))
    (odd,) = found(swings, "supply_swings")
    assert ("takes no current" in odd.why) is rises


@pytest.mark.parametrize(
    ("raw", "limit"), [(70, None), (71, "max_voltage_limit"), (35, None), (34, "min_voltage_limit")]
)
def test_a_voltage_beyond_the_factorys_limits_is_told(raw, limit):
    told = [odd.what for odd in found(with_values(VOLTS, raw), "beyond_voltage_limit")]
    assert [limit in what for what in told] == [True] * (limit is not None)


@pytest.mark.parametrize(("rise", "told"), [(4, False), (5, True)])
def test_a_servo_that_warms_is_told(rise, told):
    columns = with_values(HEAT, lambda t: np.round(30 + rise * t / t[-1]))
    assert bool(found(columns, "warming")) is told


# -- metadata


def test_notes_of_an_import_are_told_and_shuffled_rows_weigh_more():
    told = {"import": {"notes": ["unsorted times: rows 3 and 4", "goals taken for writes"]}}
    (shuffled,) = found(joint(), "shuffled_rows", **told)
    (note,) = found(joint(), "import", **told)
    assert (shuffled.weight, note.weight) == (Weight.WARNING, Weight.NOTE)


@pytest.mark.parametrize(
    ("condition", "impossible"),
    [
        ({"payload_kg": 15.0}, False),
        ({"payload_kg": 17.0}, True),
        ({"payload_kg": 0.6, "payload_at_m": 0.1}, False),
        ({"payload_kg": 1.7, "payload_at_m": 0.1}, True),
        ({"supply_v": 3.0}, False),
        ({"supply_v": 1.0}, True),
    ],
)
def test_metadata_may_be_bold_but_not_impossible(condition, impossible):
    assert bool(found(joint(), "impossible_metadata", condition=condition)) is impossible


# -- accuracy


def renewed(runs):
    """A current that is renewed after so many reads, again and again."""
    ends = np.repeat(np.arange(len(runs)), runs)
    return np.random.default_rng(5).permutation(len(runs))[ends[:300]].astype(float)


@pytest.mark.parametrize(
    ("runs", "held"), [([7] * 60, True), ([2] * 200, False), ([3, 12] * 40, False)]
)
def test_a_register_is_held_if_it_is_renewed_seldom_and_at_a_pace(runs, held):
    columns = with_values(("present_current", "read"), renewed(runs))
    assert bool(found(columns, "held")) is held


def test_a_position_that_moves_in_steps_is_not_held():
    columns = spiked(POSITION, 2048, *range(300))
    columns[POSITION][1][:] += 40 * (np.arange(300) // 7)
    assert not found(columns, "held")


@pytest.mark.parametrize(("levels", "told"), [(4, False), (8, True)])
def test_a_step_needs_some_values_to_be_one(levels, told):
    speeds = with_values(("present_velocity", "read"), 50.0 * (np.arange(300) % levels))
    assert bool(found(speeds, "coarse_steps")) is told


# -- times


def test_few_samples_are_too_short_however_long_they_took():
    assert not found(joint(seconds=6.0, period_s=0.19), "too_short")
    assert found(joint(seconds=6.0, period_s=0.25), "too_short")


def cut(from_s, to_s, columns, later_s=0.0):
    """Take a span of time out; what comes after it comes so much later."""
    return {
        key: (
            np.where(times > to_s, times + later_s, times)[(times < from_s) | (times > to_s)],
            raw[(times < from_s) | (times > to_s)],
        )
        for key, (times, raw) in columns.items()
    }


def test_a_joint_at_rest_does_not_show_a_jump_of_the_clock():
    columns = joint()
    columns[POSITION][1][:] = 2048
    columns[GOAL][1][:] = 2048
    assert found(cut(2.0, 3.0, columns), "gaps")
    assert not found(cut(2.0, 3.0, columns), "clock_jump")


@pytest.mark.parametrize(("later_s", "kind"), [(0.1, "gaps"), (1.0, "clock_jump")])
def test_a_short_jump_of_the_clock_cannot_be_told_from_a_gap(later_s, kind):
    columns = cut(1.55, 1.55, joint(), later_s)
    assert [odd.kind for odd in oddities(recording(columns)).found if odd.kind == kind] == [kind]
    other = {"gaps": "clock_jump", "clock_jump": "gaps"}[kind]
    assert not found(columns, other)


@pytest.mark.parametrize(("twice", "told"), [(2, False), (9, True)])
def test_a_time_or_two_that_come_twice_are_no_matter(twice, told):
    columns = joint()
    for times, _ in columns.values():
        times[11 : 11 + 20 * twice : 20] = times[10 : 10 + 20 * twice : 20]
    assert bool(found(columns, "repeated_times")) is told


@pytest.mark.parametrize(("periods", "told"), [(2, False), (4, True)])
def test_a_gap_is_longer_than_three_periods(periods, told):
    columns = cut(2.001, 2.006 + 0.02 * (periods - 2), joint())
    assert bool(found(columns, "gaps")) is told


def test_a_register_that_is_read_now_and_then_has_no_gaps():
    columns = joint() | {HEAT: (np.array([0.0, 0.1, 0.2, 3.0, 3.1, 5.9]), np.full(6, 30.0))}
    assert oddities(recording(columns)).found == ()


def test_a_register_that_pauses_while_the_joint_is_read_on_is_a_gap_and_no_jump_of_the_clock():
    reads = np.arange(0.0, 6.0, 0.1)
    columns = joint() | {HEAT: (reads, np.full(len(reads), 30.0))}
    assert oddities(recording(columns)).found == ()
    paused = {HEAT: cut(1.35, 3.9, {HEAT: columns[HEAT]})[HEAT]}
    assert [odd.kind for odd in oddities(recording(columns | paused)).found] == ["gaps"]


@pytest.mark.parametrize(("after", "jump"), [(8, True), (24, False)])
def test_only_a_joint_that_goes_on_at_its_pace_shows_a_jump_of_the_clock(after, jump):
    columns = joint()
    k = np.arange(300)
    run = 1000 + np.where(k < 148, 8 * k, 8 * 148 + after * (k - 148))
    columns[POSITION] = columns[POSITION][0], run.astype(float)
    assert bool(found(cut(2.95, 2.95, columns, 1.0), "clock_jump")) is jump
