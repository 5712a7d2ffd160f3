"""Timing a bus, and fitting a profile to what was measured."""

from __future__ import annotations

import csv
import itertools
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from programs import busemu, fails_in_one_line

from bench.calibration import (
    CalibrationError,
    fit,
    predict,
)
from bench.least_squares import bounded_least_squares, row_reduced
from bench.probes import (
    Condition,
    Kind,
    Timing,
    prober_in_process,
    probes_of,
    still_register,
)
from bench.return_delays import ReturnDelayError, time_at_each, varied
from bench.timing_report import describe_fit, unsteady, write_profile
from busemu.tables import load_robot
from busemu.timing import Profile, load_profile
from hal.bus_errors import NoReplyError

MARVIN, PHANTOMX = load_robot("marvin"), load_robot("phantomx")


def measured(robot, profile, delays=(0, 250), *, repeats=1, noise=0.0):
    """Timings of the model with ``profile`` at each return delay; noise as a share of a time."""
    random = np.random.default_rng(1)
    timings = []
    for delay in delays:
        condition = Condition(robot.baud_rate, (delay,) * len(robot.servos))
        for timing in prober_in_process(robot, profile, condition).time(probes_of(robot), 1):
            spread = 1.0 + noise * np.abs(random.standard_normal(repeats))
            timings.append(replace(timing, times_s=timing.median_s * spread))
    return timings


def everything(robot, baud_rate, delay):
    condition = Condition(baud_rate, (delay,) * len(robot.servos))
    return [(probe, condition) for probe in probes_of(robot)]


def sums_of(fitted):
    return {frozenset(part for _, part in total.terms): total for total in fitted.sums}


# -- the fit ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def marvin_fit():
    return fit(MARVIN, measured(MARVIN, load_profile("thesis-marvin")), "mine", "a test")


@pytest.mark.parametrize("baud_rate", [57_600, 1_000_000])
@pytest.mark.parametrize("delay", [0, 10, 120])
def test_fit_foretells_other_baud_rates_and_return_delays(marvin_fit, baud_rate, delay):
    wanted = everything(MARVIN, baud_rate, delay)
    truth_s = predict(MARVIN, load_profile("thesis-marvin"), wanted)
    assert predict(MARVIN, marvin_fit.profile, wanted) == pytest.approx(truth_s, rel=0.005)


def test_fit_finds_each_part_that_has_an_effect_of_its_own(marvin_fit):
    truth = load_profile("thesis-marvin")
    found = {part.terms[0][1]: part.value_s for part in marvin_fit.determined}
    assert found == pytest.approx(
        {
            "host_out_s": truth.host_out_s,
            "latency_timer_s": truth.latency_timer_s,
            "turnaround_s": truth.turnaround_s,
            "chain_lead_s": truth.chain_lead_s,
            "interrupt": truth.interrupt_s(),
        },
        abs=1e-7,
    )


def test_fit_says_which_parts_are_known_as_a_sum_only(marvin_fit):
    truth = load_profile("thesis-marvin")
    sums = sums_of(marvin_fit)
    assert set(sums) == {
        frozenset({"adapter_out_s", "usb_frame_s"}),
        frozenset({"wake_s", "host_in_s", "usb_frame_s"}),
    }
    way_out = sums[frozenset({"adapter_out_s", "usb_frame_s"})]
    way_in = sums[frozenset({"wake_s", "host_in_s", "usb_frame_s"})]
    assert way_out.value_s == pytest.approx(truth.out_s(), abs=1e-7)
    assert way_in.value_s == pytest.approx(truth.in_s() + truth.host_in_s, abs=1e-7)
    assert str(way_out).startswith("adapter_out_s + 0.5 usb_frame_s = 200.0 us")
    assert marvin_fit.unseen == ()


def test_at_one_return_delay_the_turnaround_is_not_in_the_data():
    truth = load_profile("thesis-marvin")
    fitted = fit(MARVIN, measured(MARVIN, truth, [250]), "mine", "")
    assert fitted.unseen == ("turnaround_s",)
    assert "not in the data at all: turnaround_s" in describe_fit(fitted)
    lead = sums_of(fitted)[frozenset({"chain_lead_s", "interrupt"})]
    assert str(lead).startswith("chain_lead_s - interrupt = 16.0 us")
    assert fitted.profile.chain_lead_s == pytest.approx(16e-6, abs=1e-7)
    assert fitted.profile.interrupt_s() == 0.0
    for baud_rate in (57_600, 1_000_000):
        wanted = everything(MARVIN, baud_rate, 250)
        assert predict(MARVIN, fitted.profile, wanted) == pytest.approx(
            predict(MARVIN, truth, wanted), rel=0.005
        )


def test_without_sync_read_the_interrupt_hides_in_the_fixed_sum():
    """Protocol 1.0: each servo is read by itself, so what it adds is never there twice."""
    truth = load_profile("thesis-phantomx")
    fitted = fit(PHANTOMX, measured(PHANTOMX, truth), "mine", "")
    fixed = sums_of(fitted)[frozenset({"wake_s", "interrupt", "host_in_s", "usb_frame_s"})]
    truth_s = truth.in_s() + truth.host_in_s + truth.interrupt_s()
    assert fixed.value_s == pytest.approx(truth_s, abs=1e-7)
    assert fitted.profile.latency_timer_s == 0.0
    for baud_rate, delay in itertools.product((57_600, 1_000_000), (0, 250)):
        wanted = everything(PHANTOMX, baud_rate, delay)
        assert predict(PHANTOMX, fitted.profile, wanted) == pytest.approx(
            predict(PHANTOMX, truth, wanted), rel=0.005
        )


@pytest.mark.parametrize("name", ["ftdi-1ms", "ftdi-16ms", "uart", "ideal"])
def test_adapters_are_told_apart_by_their_times(name):
    truth = load_profile(name)
    fitted = fit(MARVIN, measured(MARVIN, truth, [250]), "mine", "")
    assert fitted.profile.latency_timer_s == pytest.approx(truth.latency_timer_s, rel=0.02)
    wanted = everything(MARVIN, 115_200, 100)
    answered = [pair for pair in wanted if pair[0].kind is not Kind.HAND_OVER]
    assert predict(MARVIN, fitted.profile, answered) == pytest.approx(
        predict(MARVIN, truth, answered), rel=0.01
    )


@pytest.mark.parametrize("name", ["ftdi-1ms", "usb2dynamixel"])
def test_short_replies_show_that_there_is_a_latency_timer_but_not_how_long(name):
    """An AX-12 has too few registers to fill an adapter's packet, at which the timer is not due."""
    truth = load_profile(name)
    fitted = fit(PHANTOMX, measured(PHANTOMX, truth), "mine", "")
    fixed = next(total for parts, total in sums_of(fitted).items() if "latency_timer_s" in parts)
    assert "wake_s" in {part for _, part in fixed.terms}
    truth_s = truth.latency_timer_s + truth.in_s() + truth.host_in_s
    assert fixed.value_s == pytest.approx(truth_s, abs=1e-6)
    assert fitted.profile.latency_timer_s == pytest.approx(truth.latency_timer_s)
    wanted = everything(PHANTOMX, 1_000_000, 100)
    assert predict(PHANTOMX, fitted.profile, wanted) == pytest.approx(
        predict(PHANTOMX, truth, wanted), rel=0.005
    )


def test_interrupt_of_the_servos_shows_in_chains_and_is_written_by_its_mean(tmp_path):
    truth = replace(Profile("x"), interrupt_period_s=2e-3, interrupt_busy_s=0.6e-3)
    fitted = fit(MARVIN, measured(MARVIN, truth), "mine", "")
    assert fitted.profile.interrupt_s() == pytest.approx(90e-6, rel=0.01)
    path = tmp_path / "mine.toml"
    write_profile(fitted, path)
    assert load_profile(path).interrupt_s() == pytest.approx(90e-6, rel=0.01)


def test_noise_leaves_the_forecast_within_a_few_percent():
    """Half-normal noise, as waiting makes it: up to 10 % late, never early; 50 times each."""
    truth = load_profile("thesis-marvin")
    noisy = measured(MARVIN, truth, repeats=50, noise=0.05)
    fitted = fit(MARVIN, noisy, "mine", "")
    late = 1.0 + 0.05 * 0.6745  # the median of the noise
    for delay in (0, 100, 250):
        wanted = everything(MARVIN, 1_000_000, delay)
        answered = [pair for pair in wanted if pair[0].kind is not Kind.HAND_OVER]
        truth_s = predict(MARVIN, truth, answered) * late
        assert predict(MARVIN, fitted.profile, answered) == pytest.approx(truth_s, rel=0.04)
    assert all(part.error_s > 0.0 for part in (*fitted.determined, *fitted.sums))


def test_what_is_held_back_is_foretold_not_fitted():
    """A cycle that was measured at ten times its length does not move the fit."""
    honest = measured(PHANTOMX, load_profile("thesis-phantomx"), [250])
    timings = [
        replace(t, times_s=t.times_s * 10.0) if t.probe.kind is Kind.CYCLE else t for t in honest
    ]
    fitted = fit(PHANTOMX, timings, "mine", "")
    assert fitted.profile == fit(PHANTOMX, honest, "mine", "").profile
    worst = fitted.worst(held_back=True)
    assert fitted.timings[worst].probe.kind is Kind.CYCLE
    assert fitted.errors[worst] == pytest.approx(-0.9)


def test_written_profile_is_the_one_that_was_fitted(marvin_fit, tmp_path):
    path = tmp_path / "mine.toml"
    write_profile(marvin_fit, path)
    loaded = load_profile(path)
    assert loaded == marvin_fit.profile
    assert "# fitted as adapter_out_s + 0.5 usb_frame_s" in path.read_text("utf-8")


def test_too_little_is_refused():
    timings = measured(MARVIN, Profile("x"), [0])
    with pytest.raises(CalibrationError, match="too few"):
        fit(MARVIN, [t for t in timings if t.probe.kind is Kind.PING], "mine", "")


def test_bounded_least_squares_is_the_best_of_all_active_sets():
    """Every set of parts at their bound is tried by hand."""
    random = np.random.default_rng(3)
    for _ in range(60):
        matrix, wanted = random.standard_normal((9, 4)), random.standard_normal(9) * 3
        lower = -np.abs(random.standard_normal(4)) * 0.3
        best = np.inf
        for bound in itertools.product([True, False], repeat=4):
            x, free = lower.copy(), ~np.array(bound)
            if free.any():
                rest = wanted - matrix[:, ~free] @ lower[~free]
                x[free] = np.linalg.lstsq(matrix[:, free], rest, rcond=None)[0]
            if np.all(x >= lower - 1e-12):
                best = min(best, float(np.linalg.norm(matrix @ x - wanted)))
        found = bounded_least_squares(matrix, wanted, lower)
        assert np.all(found >= lower - 1e-12)
        assert np.linalg.norm(matrix @ found - wanted) == pytest.approx(best, rel=1e-9)


def test_row_reduction_shows_which_columns_come_as_a_sum():
    matrix = np.array([[1.0, 2.0, 2.0, 0.0], [3.0, 1.0, 1.0, 0.0], [4.0, 3.0, 3.0, 0.0]])
    (first, one), (second, both) = row_reduced(matrix)
    assert (first, second) == (0, 1)
    assert one == pytest.approx([1.0, 0.0, 0.0, 0.0])
    assert both == pytest.approx([0.0, 1.0, 1.0, 0.0])


# -- measuring ----------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", [MARVIN, PHANTOMX], ids=lambda robot: robot.name)
def test_timing_changes_no_register_and_moves_nothing(robot):
    prober = prober_in_process(robot, load_profile(robot.timing))
    servos = prober.bus.servos
    names = [r.name for r in servos[0].table.registers if r.writable]

    def image():
        return [{name: servo.memory[name] for name in names} for servo in servos]

    before = image()
    prober.time(probes_of(robot), 2)
    assert image() == before
    time_at_each(prober, probes_of(robot), 1)
    assert image() == before
    assert still_register(robot) == "moving_speed"


def test_times_are_those_of_the_program():
    """The thesis's figures, through the prober: one read 3 ms, a sync_read of all 13 ms."""
    times = {
        t.probe.what: t.median_s for t in measured(MARVIN, load_profile("thesis-marvin"), [250])
    }
    assert times["read of 2 B"] == pytest.approx(3.0e-3, rel=0.01)
    assert times["sync_read of 18 x 2 B"] == pytest.approx(13.0e-3, rel=0.01)


def test_distribution_is_told_by_median_and_5_to_95_percent():
    times_s = np.arange(1.0, 102.0)
    timing = Timing(probes_of(MARVIN)[0], Condition(1_000_000, (0,)), times_s)
    assert timing.median_s == 51.0
    assert timing.span_s == (6.0, 96.0)


def test_times_of_a_busy_host_are_called_so():
    truth = load_profile("thesis-marvin")
    assert unsteady(measured(MARVIN, truth, [250], repeats=40, noise=0.05)) is None
    warning = unsteady(measured(MARVIN, truth, [250], repeats=40, noise=0.3))
    assert "the host was busy" in warning


def test_a_servo_that_does_not_answer_ends_the_timing():
    prober = prober_in_process(MARVIN, Profile("x"))
    prober.client.write(5, "id", 200)
    with pytest.raises(NoReplyError, match="servo 5"):
        prober.time(probes_of(MARVIN), 1)


# -- return delays ------------------------------------------------------------------------------


def mixed_prober():
    delays = tuple(range(10, 28))
    return prober_in_process(MARVIN, Profile("x"), Condition(1_000_000, delays)), delays


def delays_now(prober):
    return tuple(servo.memory["return_delay_time"] for servo in prober.bus.servos)


def test_return_delays_are_each_put_back():
    prober, delays = mixed_prober()
    timings = time_at_each(prober, probes_of(MARVIN)[:2], 1)
    assert [t.condition.return_delay for t in timings] == ["0", "0", "250", "250"]
    assert delays_now(prober) == delays


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_return_delays_are_put_back_after_an_interruption(error):
    prober, delays = mixed_prober()

    def interrupt():
        assert delays_now(prober) == (0,) * 18
        raise error

    with pytest.raises(error):
        time_at_each(prober, probes_of(MARVIN), 1, interrupt)
    assert delays_now(prober) == delays


def test_a_second_ctrl_c_does_not_stop_the_putting_back():
    prober, delays = mixed_prober()
    sleep = prober.clock.sleep_until
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]

    def impatient(instant_s):
        signal.raise_signal(signal.SIGINT)
        sleep(instant_s)

    def be_ended():
        with varied(prober.client, prober.ids, prober.clock) as set_to:
            set_to.set(0)
            prober.clock.sleep_until = impatient
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        be_ended()
    assert delays_now(prober) == delays
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)] == before


def test_a_servo_whose_torque_is_on_is_left_alone():
    prober, delays = mixed_prober()
    prober.client.write(7, "torque_enable", 1)
    with pytest.raises(ReturnDelayError, match="torque is on at servo 7"):
        time_at_each(prober, probes_of(MARVIN), 1)
    assert delays_now(prober) == delays


def test_what_cannot_be_put_back_is_named_with_its_value():
    prober, delays = mixed_prober()

    def lose_a_servo():
        with varied(prober.client, prober.ids, prober.clock) as set_to:
            set_to.set(0)
            prober.client.write(3, "id", 200)

    with pytest.raises(ReturnDelayError, match=r"set it by hand: 11 at servo 3$"):
        lose_a_servo()
    assert delays_now(prober) == (delays[0], 0, *delays[2:])  # servo 3 is the second of the robot


# -- the command --------------------------------------------------------------------------------


def rows_of(path):
    return list(csv.DictReader(path.read_text("utf-8").splitlines()))


def test_the_command_times_the_model_writes_files_and_fits(tmp_path):
    words = ["--robot", "phantomx", "--virtual", "--repeats", 2, "--out", tmp_path / "out"]
    done = busemu("timing", *words, "--vary-return-delay", "--fit", tmp_path / "mine.toml")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert any(line.split()[:5] == ["read", "of", "2", "B", "250"] for line in lines)
    assert "determined only as sums (how they divide is not in the data):" in lines
    rows = rows_of(tmp_path / "out" / "timing.csv")
    read = next(
        row
        for row in rows
        if row["transaction"] == "read of 2 B" and row["return_delay_time"] == "250"
    )
    assert float(read["median_s"]) == pytest.approx(1e-3, rel=0.01)
    singles = rows_of(tmp_path / "out" / "times.csv")
    assert len(singles) == 2 * len(rows) == 4 * len(probes_of(PHANTOMX))
    assert (tmp_path / "out" / "timing.png").read_bytes().startswith(b"\x89PNG")
    assert load_profile(tmp_path / "mine.toml").turnaround_s == pytest.approx(22e-6, abs=1e-7)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--robot", "marvin"], "--virtual"),
        (["--robot", "marvin", "--virtual", "--repeats", "0"], "--repeats"),
        (["--robot", "marvin", "--virtual", "--fit", "mine.txt"], ".toml"),
        (["--robot", "marvin", "--port", "/dev/nowhere"], "/dev/nowhere"),
        (["--robot", "marvin", "--virtual", "--repeats", "1", "--out", "/proc/no"], "/proc/no"),
    ],
)
def test_bad_words_get_one_clear_line_and_a_failure(words, says):
    fails_in_one_line(busemu("timing", *words), says)


@pytest.mark.pty
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGHUP])
def test_return_delays_of_a_served_robot_are_put_back_however_the_program_ends(servo_bus, ending):
    bus = servo_bus("phantomx", wall=True, timing="ideal")
    words = ["--robot", "phantomx", "--port", bus.path, "--vary-return-delay"]
    program = subprocess.Popen(
        [sys.executable, "-m", "busemu", "timing", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    until_s = time.monotonic() + 20.0
    while bus.servo(18).register("return_delay_time") != 0:
        assert time.monotonic() < until_s, program.communicate()
        assert program.poll() is None, program.communicate()
    program.send_signal(ending)
    said, _ = program.communicate(timeout=20.0)
    assert program.returncode == 130
    assert b"the servos are as they were" in said
    assert {bus.servo(i).register("return_delay_time") for i in range(1, 19)} == {250}
