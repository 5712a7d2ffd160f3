"""Hidden effects: nothing at their off value, more than the floor at their largest."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bench.blind import sizing
from bench.blind.changes import Setting
from bench.blind.effects import EFFECTS, POSITION
from bench.blind.host import Line, commands, schedule
from bench.blind.instant import Gate, GateKind
from bench.blind.nuisances import Nuisances
from bench.blind.pendulum import TICK_S, Trace, roll
from bench.blind.rigs import BREAKAWAY_RAD, RIGS, STYLES, Run
from bench.blind.specimen import Build, Specimen
from bench.blind.unlisted import STRANGERS
from bench.motions import ExperimentPlan, motion

ALL = {**EFFECTS, **STRANGERS}
RUN = Run("steps", ExperimentPlan(motion("steps", duration_s=3.0), payload_kg=0.2))
LIFT = Run(
    "lift", ExperimentPlan(motion("lift_and_drop", lift_s=1.0, duration_s=2.5), payload_kg=0.2)
)
BASE = RIGS["xl330-pendulum"].specimen(0.2)


def rolled(specimen: Specimen, run: Run = RUN) -> Trace:
    timing = schedule(STYLES["fast"], run.plan.motion.duration_s, Line(), np.random.default_rng(0))
    return roll(specimen, commands(run.plan, specimen.sheet, timing))


@pytest.fixture(scope="module")
def base() -> Trace:
    return rolled(BASE)


@pytest.mark.parametrize("name", ALL)
def test_effect_at_off_is_no_effect_to_the_bit(name: str, base: Trace) -> None:
    specimen, truth = ALL[name].apply(BASE, 0.0, Setting())
    off = rolled(specimen)
    for field in ("t_s", "position_rad", "sensed_rad", "velocity_rad_s", "duty", "current_a"):
        assert np.array_equal(getattr(off, field), getattr(base, field)), field
    assert specimen.sensing == BASE.sensing
    first = next(iter(truth.values()))
    assert first.value == first.off or name == "overload_shutdown"


@pytest.mark.parametrize("name", ALL)
def test_effect_at_its_largest_is_more_than_eight_floors(name: str) -> None:
    effect = ALL[name]
    floor = sizing.noise_floor(sizing.Key("xl330-pendulum", "fast", "fast"), effect.channel)
    runs = (RUN, LIFT) if name in ("rotor_inertia", "link_mass", "com_offset") else (RUN,)
    squares = []
    for run in runs:
        specimen, _ = effect.apply(BASE, effect.most, Setting(choice=0.0))
        moved = sizing.observe(STYLES["fast"], run, specimen, effect.channel)
        still = sizing.observe(STYLES["fast"], run, BASE, effect.channel)
        squares.append((moved - still) ** 2)
    assert np.sqrt(np.mean(np.concatenate(squares))) > 8.0 * floor


@pytest.mark.parametrize("wanted", [1.0, 8.0])
def test_size_has_the_ratio_that_was_asked_for(wanted: float) -> None:
    key = sizing.Key("xl330-turntable", "fast", "slow")
    found = sizing.size_for(key, "dead_zone", wanted, Setting())
    assert found is not None
    assert found.ratio == pytest.approx(wanted, rel=sizing.CLOSE)
    moved = sizing.rms(sizing.change(key, "dead_zone", found.size, Setting()))
    assert moved / sizing.noise_floor(key) == found.ratio


def test_size_counts_from_the_nuisances_bound() -> None:
    for name, effect in EFFECTS.items():
        assert bool(effect.allowance) == bool(effect.pins) or name == "gain_error"
    _, truth = EFFECTS["link_mass"].apply(BASE, 0.01, Setting())
    assert truth["factor"].value == pytest.approx(1.0 + EFFECTS["link_mass"].allowance + 0.01)


def test_noise_floor_is_more_than_the_quantisation() -> None:
    key = sizing.Key("xl330-turntable", "fast", "slow")
    assert sizing.noise_floor(key) > RIGS[key[0]].sheet.step_rad / np.sqrt(12.0)


def test_sizes_are_measured_on_the_servo_as_it_is_built(monkeypatch: pytest.MonkeyPatch) -> None:
    build = Build(sprung=True, presliding=True)
    key = sizing.Key("xl330-turntable", "fast", "slow", build)
    seen = []
    monkeypatch.setattr(
        sizing, "observe", lambda _s, _r, specimen, _c: seen.append(specimen) or np.ones(2)
    )
    assert sizing.rms(sizing.change(key, "stribeck_friction", 0.031, Setting())) == 0.0
    sheet = RIGS[key.rig].sheet
    assert len(seen) == 10
    assert {one.gear.stiffness_nm_rad for one in seen} == {sheet.gear_stiffness_nm_rad}
    assert {one.bristle_nm_rad for one in seen} == {sheet.coulomb_nm / BREAKAWAY_RAD}
    assert sorted(len(one.parts) for one in seen) == [1] * 10  # with a size of 0 without it


def test_a_more_springy_gear_counts_from_the_spring_that_is_there() -> None:
    built = RIGS["xl330-pendulum"].specimen(0.2, Build(sprung=True))
    stiffness = built.sheet.gear_stiffness_nm_rad
    same, off = EFFECTS["joint_compliance"].apply(built, 0.0, Setting())
    assert same == built
    assert off["stiffness_nm_rad"].value == off["stiffness_nm_rad"].off == stiffness
    soft, truth = EFFECTS["joint_compliance"].apply(built, 0.05, Setting())
    assert 1.0 / soft.gear.stiffness_nm_rad == pytest.approx(1.0 / stiffness + 0.05)
    more = truth["damping_nm_s_rad"].value
    assert soft.gear.damping_nm_s_rad == pytest.approx(built.gear.damping_nm_s_rad + more)


def test_size_that_no_plausible_value_reaches_is_none() -> None:
    key = sizing.Key("xl330-turntable", "fast", "slow")
    assert sizing.size_for(key, "zero_offset", 8.0, Setting()) is None


def test_ratio_for_fitting_counts_the_groups_for_fitting_on_the_rig_as_it_is() -> None:
    where = sizing.ground(sizing.Key("xl330-turntable", "fast", "slow"))
    size, how = 0.9, Setting(choice=0.0)
    for name in ("dead_zone", "overload_shutdown"):
        never = sizing.ratio_fitted(where, name, 0.0, how, Nuisances())
        assert never == 0.0
    seen = sizing.ratio_fitted(where, "overload_shutdown", size, how, Nuisances())
    assert seen > 8.0
    strong = Nuisances(coulomb_factor=0.0, viscous_factor=0.1, torque_constant_factor=3.0)
    assert sizing.ratio_fitted(where, "overload_shutdown", size, how, strong) != seen
    held = dataclasses.replace(
        where.programme, held_out=tuple(run.group for run in where.programme.runs[1:])
    )
    fewer = dataclasses.replace(where, programme=held)
    assert sizing.ratio_fitted(fewer, "overload_shutdown", size, how, Nuisances()) != seen


@pytest.mark.parametrize("size", [1e-6, 0.1])
def test_a_load_register_is_renewed_as_believed_or_plainly_more_seldom(size: float) -> None:
    slow = RIGS["ax12-turntable"].specimen(0.0)
    believed = slow.sheet.load_refresh_s
    assert believed > 0.0
    prompt, _ = EFFECTS["load_refresh"].apply(BASE.but(tick_s=1.4e-3), size, Setting())
    assert prompt.sensing.hold_s == pytest.approx(1.2 * 1.4e-3 + size)
    still, _ = EFFECTS["load_refresh"].apply(slow, 0.0, Setting())
    assert still.sensing.hold_s == believed
    moved, truth = EFFECTS["load_refresh"].apply(slow, size, Setting())
    assert moved.sensing.hold_s == truth["period_s"].value >= 1.2 * believed


@pytest.mark.parametrize("name", [n for n, e in EFFECTS.items() if GateKind.TIME in e.gates])
def test_rare_effect_is_there_in_its_window_only(name: str, base: Trace) -> None:
    gate = Gate(GateKind.TIME, 0.9, 1.3)
    effect = EFFECTS[name]
    specimen, _ = effect.apply(BASE, 0.8 * effect.most, Setting(gate=gate))
    rare = rolled(specimen)
    before = base.t_s < gate.low - 1e-9
    apart = np.abs(rare.position_rad - base.position_rad)
    assert apart[before].max() == 0.0
    assert apart.max() > BASE.sheet.step_rad


def test_worn_sector_plays_there_only(base: Trace) -> None:
    gate = Gate(GateKind.ANGLE, 0.3, 0.5)
    specimen, _ = EFFECTS["backlash"].apply(BASE, 0.08, Setting(gate=gate))
    worn = rolled(specimen)
    far = rolled(
        EFFECTS["backlash"].apply(BASE, 0.08, Setting(gate=Gate(GateKind.ANGLE, 9, 10)))[0]
    )
    apart = np.abs(worn.position_rad - far.position_rad)
    inside = (far.position_rad > gate.low) & (far.position_rad < gate.high)
    assert inside.any()
    assert apart[: int(np.argmax(inside))].max() < 1e-9
    assert apart.max() > BASE.sheet.step_rad


def test_names_are_those_of_the_catalogue_and_strangers_are_not() -> None:
    assert not set(EFFECTS) & set(STRANGERS)
    assert len(EFFECTS) == 28
    for effect in ALL.values():
        assert set(effect.rivals) <= set(EFFECTS)
        assert effect.channel in (POSITION, "duty")
    with pytest.raises(ValueError, match="no effect named 'gremlin'"):
        sizing.effect_named("gremlin")


def test_delay_shifts_the_goal_by_its_parameter() -> None:
    late = rolled(BASE.but(goal_late_s=0.05))
    duty = rolled(BASE).duty
    first = int(np.argmax(np.abs(np.diff(duty)) > 0.05))
    later = int(np.argmax(np.abs(np.diff(late.duty)) > 0.05))
    assert (later - first) * TICK_S == pytest.approx(0.05, abs=2 * TICK_S)
