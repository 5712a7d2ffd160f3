"""What the registers of a hidden servo show, and since when."""

from __future__ import annotations

import numpy as np
import pytest

from bench.blind.host import RAIL_LAG_S, Line, Schedule, Shown, held, schedule, show
from bench.blind.pendulum import Trace
from bench.blind.rigs import RIGS, STYLES
from bench.blind.specimen import Specimen

TICK_S = 1.25e-3
BASE = RIGS["xl330-pendulum"].specimen()
TIMING = schedule(STYLES["fast"], 1.0, Line(), np.random.default_rng(0))


def ramp() -> Trace:
    """Everything goes up evenly; the noise of a count is a whole one at every other tick."""
    t_s = np.arange(-100, 900) * TICK_S
    count = np.round(t_s / BASE.sheet.step_rad) + np.arange(1000) % 2
    return Trace(t_s, t_s, t_s, count, t_s, 0.5 * t_s, 5.0 + t_s, t_s, 20.0 + t_s)


def shown(specimen: Specimen, timing: Schedule = TIMING) -> Shown:
    return show(specimen, ramp(), timing, Line(), np.random.default_rng(1))


def test_an_angle_is_shown_as_it_was_counted_at_the_last_tick() -> None:
    found = shown(BASE)
    at = TIMING.sample_s[:, TIMING.style.reads.index("position")]
    assert np.all((at - found.taken_s >= 0.0) & (at - found.taken_s < TICK_S))
    assert found.truth_rad == pytest.approx(found.taken_s)
    tick = np.round(found.taken_s / TICK_S).astype(int) + 100
    off = np.asarray(found.counts["position"]) - ramp().count[tick]
    assert len(set(off.tolist())) == 1  # the register's zero


def test_a_voltage_is_shown_until_it_is_measured_again() -> None:
    period_s, phase_s = 16e-3, 5e-3
    found = shown(BASE.sensing_but(voltage_hold_s=period_s, hold_phase_s=phase_s))
    at = TIMING.sample_s[:, TIMING.style.reads.index("voltage")]
    measured = held(at, period_s, phase_s)
    assert np.all((at - measured >= 0.0) & (at - measured < period_s))
    late = measured - (found.roles["voltage"] - 5.0) - 0.5 * RAIL_LAG_S
    assert np.all((late > -1e-9) & (late < TICK_S))
    assert 40 < len(np.unique(found.roles["voltage"])) < 65  # a second of 16 ms
    prompt = shown(BASE)
    assert len(np.unique(prompt.roles["voltage"])) > 150


def test_a_duty_is_shown_at_once_unless_it_is_held() -> None:
    at = TIMING.sample_s[:, TIMING.style.reads.index("duty")]
    prompt = at - 2.0 * shown(BASE).roles["duty"]
    assert np.all((prompt > -1e-9) & (prompt < TICK_S))
    slow = shown(BASE.sensing_but(hold_s=0.05)).roles["duty"]
    assert len(np.unique(slow)) <= 21
