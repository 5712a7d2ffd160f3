"""Knobs and nuisances: numbers around zero that turn physics on."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pendulum_logs import logs, model_of, robot

from bench.diagnosis.joint.fit import bounds
from bench.diagnosis.joint.model import Hypothesis, JointModel
from bench.diagnosis.joint.nuisances import (
    CENTRE_M,
    LOAD_OF_GEAR,
    MASS,
    NUISANCES,
    WITHIN,
    nuisances,
)
from bench.diagnosis.knobs import (
    AMOUNTS,
    TWINS,
    effect_knobs,
    joint_effects,
    of_drive,
    with_effects,
)
from sim.drive import fields
from sim.effects import catalogue, effect
from sim.entries import Section
from sim.model import read_model
from sim.one_joint import one_joint_load
from sim.rollout import Batch, Candidate, Load

KNOBS = {k.name: k for e in catalogue().values() for k in effect_knobs(e)}


@pytest.mark.parametrize("name", sorted(KNOBS))
def test_zero_is_off_or_for_a_logarithmic_shape_typical(name):
    knob = KNOBS[name]
    wanted = knob.parameter.typical if knob.logarithmic else knob.parameter.off
    assert knob.value(0.0) == wanted


@pytest.mark.parametrize("name", sorted(KNOBS))
def test_bounds_are_the_catalogues(name):
    knob = KNOBS[name]
    p = knob.parameter
    low, high = knob.bounds
    ends = sorted((knob.value(low), knob.value(high)))
    wanted = [p.low, math.inf] if knob.inverse else [p.low, p.high]
    assert ends == pytest.approx(wanted)
    for z in (low, high):
        p.check(knob.value(z))


@pytest.mark.parametrize("name", sorted(KNOBS))
def test_a_value_goes_one_way_with_its_number_and_stays_within_bounds(name):
    knob = KNOBS[name]
    z = np.linspace(*knob.bounds, 101)
    values = np.array([knob.value(x) for x in z])
    for value in values:
        knob.parameter.check(value)
    finite = values[np.isfinite(values)]
    assert (np.diff(finite) > 0.0).all() or (np.diff(finite) < 0.0).all()
    assert knob.value(knob.bounds[1] + 100.0) in (knob.parameter.low, knob.parameter.high)


@pytest.mark.parametrize("name", sorted(KNOBS))
def test_one_is_an_effect_of_typical_size(name):
    knob = KNOBS[name]
    p = knob.parameter
    if not p.shape:
        # an effect without a typical size of its own has a sixth of its range
        wanted = p.typical if p.typical != p.off else p.off + (p.high - p.low) / 6.0
        assert knob.value(1.0) == pytest.approx(wanted)


@pytest.mark.parametrize("name", sorted(KNOBS))
def test_the_slope_is_that_of_the_value(name):
    knob = KNOBS[name]
    z = 0.5 * (1.0 + min(knob.bounds[1], 2.0))
    step = 1e-6
    slope = (knob.value(z + step) - knob.value(z - step)) / (2.0 * step)
    assert abs(slope) == pytest.approx(knob.slope(z), rel=1e-4)


@pytest.mark.parametrize("name", sorted(joint_effects()))
def test_a_knob_at_zero_leaves_the_robot_as_it_is(name):
    base = read_model(robot())
    knobs = [k for k in effect_knobs(effect(name)) if not k.logarithmic]
    assert with_effects(base, knobs, [0.0] * len(knobs)) == base


def test_knobs_of_one_effect_act_together():
    base = read_model(robot())
    knobs = effect_knobs(effect("directional_load_friction"))
    friction = with_effects(base, knobs, [1.0, 2.0]).joints[0].drive.friction
    assert friction.load_motor == pytest.approx(0.15)
    assert friction.load_external == pytest.approx(0.8)


# --- nuisances


def candidate(moment=1.0):
    """An arm with a weight; ``moment`` is the weight times its lever, over gravity's torque."""
    base = read_model(robot())
    arm = Load.pendulum(1e-4, 0.01, 0.0, 0.01 * moment)
    weight = Load.pendulum(2e-3, 0.1, 0.0, 0.1 * moment)
    one = Candidate.of(base, 0, arm.plus(weight, 1.0), rigid=False)
    return replace(one, payload=weight)


def parts(one):
    load = (one.load.inertia_kg_m2, *one.load.sine_nm, *one.load.cosine_nm)
    return *one.drive.tolist(), *load, one.voltage_v, one.skew_s + one.late_s


@pytest.mark.parametrize("nuisance", NUISANCES, ids=lambda n: n.name)
def test_every_nuisance_changes_a_candidate_and_none_of_it_at_zero(nuisance):
    assert parts(nuisance.change(candidate(), 0.0)) == pytest.approx(parts(candidate()), rel=1e-12)
    leaning = candidate(moment=1.5)  # an axis that is not level: all matters there
    moved = parts(nuisance.change(leaning, nuisance.deviation))
    assert moved != pytest.approx(parts(candidate(moment=1.5)), rel=1e-6)


def by_name(name):
    return next(n for n in NUISANCES if n.name == name)


@pytest.mark.parametrize("nuisance", NUISANCES, ids=lambda n: n.name)
def test_a_number_that_a_nuisance_makes_is_undone(nuisance):
    made = nuisance.value(0.7, 1.0, 0.05)
    assert made == (
        math.exp(0.7 * nuisance.deviation)
        if nuisance.logarithmic
        else pytest.approx(1.0 + 0.7 * nuisance.deviation * 0.05)
    )
    assert nuisance.at(made, 1.0, 0.05) == pytest.approx(0.7)


def test_a_heavier_link_leaves_the_payload_as_it_is():
    moved = by_name("link").change(candidate(), 0.5)
    assert moved.load.sine_nm == pytest.approx(1.5 * 0.01 + 0.1)
    assert by_name("payload").change(candidate(), 0.5).load.sine_nm == pytest.approx(0.01 + 0.15)


def test_a_centre_beside_the_link_turns_the_links_weight_and_leaves_the_payload():
    base, x = read_model(robot()), 0.01
    (body,) = base.bodies
    (along,) = [abs(c) for c in body.mass.centre_m if c != 0.0]
    beside = np.cross(body.axis, body.mass.centre_m) * x  # at right angles, x times as far
    moved = effect("com_offset").apply(
        base, (), dict(zip(("x_m", "y_m", "z_m"), beside, strict=True))
    )
    told, believed = one_joint_load(moved), one_joint_load(base)
    assert abs(told.centre_rad - believed.centre_rad) == pytest.approx(x, rel=1e-3)
    turned = by_name("centre").change(candidate(), x)
    own = 0.01 * np.array([np.cos(x), np.sin(x)])
    assert turned.load.sine_nm == pytest.approx(0.1 + own[0], rel=1e-3)
    assert abs(turned.load.cosine_nm) == pytest.approx(own[1], rel=1e-3)
    assert along > 0.0


def test_a_link_that_hangs_askew_turns_as_a_whole():
    askew, x = 0.7, 0.01
    bare = replace(candidate(), load=Load.pendulum(1e-3, 0.1, askew, 0.1), payload=None)
    turned = by_name("centre").change(bare, x).load
    wanted = Load.pendulum(1e-3, 0.1, askew + x, 0.1)
    assert turned.sine_nm == pytest.approx(wanted.sine_nm, rel=1e-3)
    assert turned.cosine_nm == pytest.approx(wanted.cosine_nm, rel=1e-3)


def test_the_nearer_a_centre_of_mass_the_more_its_tolerance_means():
    drive = Section(robot().path, "", robot().document).section("drive").section("XL330-M288")
    near, far, unknown = (
        {n.name: n.deviation for n in nuisances(drive, None, lever_m)}
        for lever_m in (0.03, 0.3, None)
    )
    assert near["centre"] == pytest.approx(10.0 * far["centre"])
    assert near["link"] > unknown["link"] > far["link"]
    assert WITHIN * far["link"] == pytest.approx(MASS + CENTRE_M / 0.3)


def test_a_stand_that_leans_pulls_at_the_hanging_arm():
    moved = by_name("tilt").change(candidate(), 0.01)
    assert moved.load.cosine_nm == pytest.approx(0.01 * 0.11)
    # the axis lies level: leaning across changes nothing to first order
    across = by_name("tilt_across").change(candidate(), 0.01)
    assert across.load.sine_nm == pytest.approx(candidate().load.sine_nm)


@pytest.mark.parametrize("moment", [0.0, -1e-9])
def test_a_load_of_which_nothing_is_left_leans_without_a_word(moment):
    leans = Load.pendulum(1e-3, 2.0 * moment, 0.0, moment).tilted(0.0, 0.01)
    assert np.isfinite([leans.sine_nm, leans.cosine_nm]).all()


@pytest.mark.parametrize("name", sorted(TWINS))
def test_a_twin_and_its_nuisance_change_the_same(name):
    """So one of the two can stand for the other."""
    nuisance = by_name(TWINS[name])
    (parameter,) = (knob.parameter for knob in effect_knobs(effect(name)))
    x = nuisance.deviation
    base = read_model(robot())
    load = Load.pendulum(1e-3, 0.1, 0.0, 0.1)
    column = Candidate.of(base, 0, load, rigid=True).drive
    amount = column[AMOUNTS[nuisance.name]] if nuisance.name in AMOUNTS else 1.0
    robot_with = effect(name).apply(base, (), {parameter.name: parameter.off + amount * x})
    as_effect = Candidate.of(robot_with, 0, load, rigid=True)
    as_nuisance = nuisance.change(Candidate.of(base, 0, load, rigid=True), x)
    if name == "payload":  # of the body, and one takes kilograms, the other shares of the weight
        added = robot_with.bodies[0].mass.mass_kg - base.bodies[0].mass.mass_kg
        assert added == pytest.approx(x)
        weight = replace(Candidate.of(base, 0, load, rigid=True), payload=load)
        assert nuisance.change(weight, x).load.sine_nm == pytest.approx((1.0 + x) * load.sine_nm)
    elif name == "link_mass":  # of the body, not of the candidate
        assert robot_with.bodies[0].mass.mass_kg == pytest.approx(
            (1 + x) * base.bodies[0].mass.mass_kg
        )
        assert as_nuisance.load.sine_nm == pytest.approx((1.0 + x) * load.sine_nm)
    else:
        assert parts(as_effect) == pytest.approx(parts(as_nuisance))


@pytest.mark.slow
def test_a_twin_idles_its_nuisance_and_no_other():
    told = model_of(logs()).observed
    model = JointModel(read_model(robot()), robot(), told, sprung=True)
    free_low, free_high = bounds(model, Hypothesis())
    idle = [n.name for n, a, b in zip(model.nuisances, free_low, free_high, strict=True) if a == b]
    assert idle == [LOAD_OF_GEAR]  # there is no friction of load
    for name, twin in TWINS.items():
        low, high = bounds(model, Hypothesis(effect_knobs(effect(name))))
        idle = [
            n.name for n, a, b in zip(model.nuisances, low, high, strict=False) if a == b == 0.0
        ]
        assert [one for one in idle if one != LOAD_OF_GEAR] == [twin]
        count = len(model.nuisances)
        kept = [k for k, n in enumerate(model.nuisances) if n.name != twin]
        assert (high[:count][kept] == free_high[kept]).all()


def test_a_robot_file_may_say_how_sure_it_is():
    drives = Section(robot().path, "", robot().document).section("drive")
    told = {n.name: n.deviation for n in nuisances(drives.section("XL330-M288"))}
    usual = {n.name: n.deviation for n in NUISANCES}
    entries = robot().document["drive"]["XL330-M288"]
    assert told["torque_constant"] == entries["stall_torque_nm"]["deviation"]
    assert told["back_emf"] == entries["no_load_velocity_rad_s"]["deviation"]
    assert told["gain"] == usual["gain"]
    assert len(candidate().drive) == fields.PARAMS


@pytest.mark.parametrize("less", [0.9, 1.0, 4.0])
@pytest.mark.slow
def test_a_rotor_that_is_hardly_known_keeps_an_inertia_that_a_spring_can_move(less):
    """Of a file whose deviation is its whole value, fits try lighter rotors than none."""
    model = JointModel(read_model(robot()), robot(), model_of(logs(motions=["fast"])).observed)
    sprung = model.of(model.observed, sprung=True)
    made = sprung.candidate(Hypothesis(), np.zeros(len(sprung.nuisances)), 0)
    (level,) = (n for n in sprung.nuisances if n.name == "rotor_level")
    lighter = level.change(replace(made, drive=made.drive.copy()), -less)
    assert 0.0 < lighter.drive[fields.ROTOR_INERTIA] < made.drive[fields.ROTOR_INERTIA]
    (out,) = Batch([sprung.observed[0].replay], 1).run([lighter], [0])
    assert np.abs(out).max() < 1e3


@pytest.mark.parametrize("name", ["coulomb_friction", "viscous_friction"])
def test_no_effect_takes_more_friction_from_a_drive_than_it_has(name):
    drive = read_model(robot()).joints[0].drive
    own = {
        "coulomb_friction": drive.friction.coulomb_nm,
        "viscous_friction": drive.friction.viscous_nm_s_rad,
    }
    bounded = of_drive(joint_effects(), drive)
    (knob,) = effect_knobs(bounded[name])
    assert knob.value(knob.bounds[0]) == pytest.approx(-own[name])
    (before,) = effect_knobs(joint_effects()[name])
    assert knob.bounds[1] == before.bounds[1]
    others = set(bounded) - set(own)
    assert all(bounded[other] is joint_effects()[other] for other in others)
