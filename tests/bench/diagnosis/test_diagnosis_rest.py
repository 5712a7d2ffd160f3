"""What is left: what engines may differ by, what tolerances take up, and what is unexplained."""

from dataclasses import replace

import numpy as np
import pytest
from pendulum_logs import DUTY, JOINT, POSITION, VOLTS, logs, model_of, robot

from bench.diagnosis.joint.diagnosis import diagnose_joint
from bench.diagnosis.joint.fit import Fit, estimate_noise, fit
from bench.diagnosis.joint.floor import REPEATS, SOUND_RAD, engines_rad, held_band_rad, noise_floor
from bench.diagnosis.joint.model import Hypothesis, JointModel, Kind
from bench.diagnosis.joint.remainder import Remainder
from bench.diagnosis.joint.rest import Rest, is_structured, rest_of, volts_left
from bench.diagnosis.observed import observe
from bench.diagnosis.report.telling import advice
from sim.drive import fields
from sim.effects import effect
from sim.model import read_model


def slow():
    return observe(logs(motions=["slow"]), robot(), JOINT)


def rough_by(coulomb_nm, observed=None):
    """The pendulum, with another dry friction believed of it."""
    base = read_model(robot())
    (joint,) = base.joints
    friction = replace(joint.drive.friction, coulomb_nm=coulomb_nm, stribeck_nm=0.0)
    joint = replace(joint, drive=replace(joint.drive, friction=friction))
    return JointModel(replace(base, joints=(joint,)), robot(), observed or slow())


def test_the_band_in_which_friction_holds_a_joint_goes_with_friction():
    one, other = (held_band_rad(rough_by(nm), 0) for nm in (0.02, 0.05))
    assert one > 0.0
    assert other == pytest.approx(2.5 * one)


def test_the_band_is_friction_over_the_stiffness_of_position_law_and_gravity():
    model = rough_by(0.02)
    (one,) = model.observed
    believed = model.candidate(Hypothesis(), np.zeros(len(model.nuisances)), 0)
    away = 0.02 / held_band_rad(model, 0)  # what holds it for a radian off its goal [N m]
    stall = believed.drive[fields.TORQUE_CONSTANT] * believed.voltage_v
    law = one.replay.start[fields.GAIN_CW] * stall / believed.drive[fields.RESISTANCE]
    assert law < away < law + believed.load.moment_nm


def test_engines_differ_by_a_share_of_the_band_and_never_by_less_than_sound_ones():
    assert engines_rad(rough_by(0.0)) == SOUND_RAD
    model = rough_by(0.05)
    wanted = np.hypot(SOUND_RAD, REPEATS * held_band_rad(model, 0))
    assert engines_rad(model) == pytest.approx(wanted)


def test_what_no_position_law_holds_has_no_band():
    (one,) = slow()
    start = one.replay.start.copy()
    start[fields.MODE] = fields.MODE_PWM
    free = replace(one, replay=replace(one.replay, start=start))
    assert held_band_rad(rough_by(0.05, [free]), 0) == 0.0


@pytest.mark.parametrize(("engines", "structured"), [(0.001, True), (0.002, False)])
def test_a_rest_is_unexplained_only_beyond_what_engines_may_differ_by(engines, structured):
    rest = Remainder(0.002, 0.9, 1.0, ())
    assert is_structured(rest, 0.0021, 0.0005, engines) is structured


def test_a_rest_is_foretold_where_it_is_no_noise():
    told = Remainder(0.003, 0.9, 1.0, ())
    assert Rest({}, told, structured=True).foretold == pytest.approx(9e-6)
    assert Rest({}, told, structured=False).foretold == 0.0


def believed_of(recordings):
    """A model with all tolerances as believed, its fit, and its noise floor."""
    model = model_of(recordings)
    z = np.zeros(len(model.nuisances))
    blocks = model.residuals(Hypothesis(), [z])[0]
    found = Fit(Hypothesis(), z, estimate_noise(model, blocks), 0.0)
    return model, found, noise_floor(model.observed, blocks)


@pytest.mark.parametrize(
    ("truth", "structured"),
    [
        ({"gain_error": {"scale": 0.95}}, False),
        ({"dead_zone": {"margin_rad": 0.05}}, True),
    ],
)
def test_what_tolerances_take_up_in_all_recordings_lacks_no_physics(truth, structured):
    model, found, floor = believed_of(logs(truth, motions=["slow", "fast"]))
    judge, *_ = believed_of(logs(truth, motions=["steps", "swell"]))
    assert rest_of(judge, judge, found, floor).structured
    rest = rest_of(model, judge, found, floor)
    assert rest.structured is structured
    assert Kind.POSITION in {kind for _, kind in rest.blocks}


def with_volts(scale, registers=(POSITION, DUTY, VOLTS)):
    """A pendulum whose supply is not what its file believes."""
    truth = {"supply_voltage": {"scale": scale}}
    return observe(logs(truth, ("slow", "steps"), registers=registers), robot(), JOINT)


@pytest.mark.slow
def test_a_voltage_that_nothing_explains_is_not_consistent():
    """The replays are under it, so that the motion is as it should be."""
    effects = {"dead_zone": effect("dead_zone")}
    told = diagnose_joint(read_model(robot()), robot(), with_volts(0.87), effects=effects).diagnosis
    assert (told.verdict, told.causes) == ("unexplained", ())
    (left,) = told.unexplained
    assert left["channel"] == "present_voltage"
    assert left["rms_v"] == pytest.approx(5.0 * (0.96 - 0.87), abs=0.1)  # 4 % are a tolerance
    assert any("measure the voltage" in each for each in advice(told))


@pytest.mark.parametrize(
    ("scale", "registers"),
    [(0.95, (POSITION, DUTY, VOLTS)), (0.87, (POSITION, DUTY))],
    ids=["hardly beyond its tolerance", "not read"],
)
def test_a_voltage_within_noise_or_that_nobody_read_is_no_finding(scale, registers):
    model = JointModel(read_model(robot()), robot(), with_volts(scale, registers))
    found = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
    assert volts_left(model, found) == 0.0
