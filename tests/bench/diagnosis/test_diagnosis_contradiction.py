"""A supply that the motion asks for, and what the voltage register says of it."""

from dataclasses import replace

import numpy as np
import pytest
from pendulum_logs import DUTY, JOINT, POSITION, VOLTS, logs, model_of, robot

from bench.diagnosis.commands import supply_events, without_supply
from bench.diagnosis.joint import contradiction
from bench.diagnosis.joint.contradiction import AT_FIRST, named_source, supply_contradiction
from bench.diagnosis.joint.fit import fit
from bench.diagnosis.joint.model import Hypothesis, JointModel, Kind
from bench.diagnosis.joint.search import Gain
from bench.diagnosis.joint.veto import objection
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.observed import Channel, observe
from sim.effects import effect
from sim.model import read_model

SOURCE_OHM = 3.0
MOTIONS = ("steps", "fast", "swell")


@pytest.fixture(scope="module")
def sagging():
    """A supply that sags, and what is believed without it."""
    truth = {"voltage_sag": {"resistance_ohm": SOURCE_OHM}}
    model = model_of(
        logs(
            truth,
            motions=MOTIONS,
            registers=(POSITION, DUTY, VOLTS),
            duration_s=4.0,
        )
    )
    return model, fit(model, Hypothesis(), np.zeros(len(model.nuisances)))


def test_a_register_that_shows_the_sag_denies_nothing(sagging):
    assert supply_contradiction(sagging[0], sagging[1], sagging[1], print) == ()


def test_a_fit_to_the_register_that_stops_where_it_began_denies_nothing(sagging, monkeypatch):
    """It is begun at what the motion asks for as well, and the deeper one is believed."""

    def stopping(model, hypothesis, start, noise):
        if start[-1] != AT_FIRST:
            return fit(model, hypothesis, start, noise)
        return fit(model, hypothesis, start, noise, held=[len(start) - 1])

    monkeypatch.setattr(contradiction, "fit", stopping)
    assert supply_contradiction(sagging[0], sagging[1], sagging[1], print) == ()


@pytest.fixture(scope="module")
def lying():
    """The same motions; the register shows a battery that runs down and charges, and no sag."""
    truth = {"voltage_sag": {"resistance_ohm": SOURCE_OHM}}
    told = observe(
        logs(truth, MOTIONS, registers=(POSITION, DUTY, VOLTS), duration_s=4.0), robot(), JOINT
    )
    return JointModel(read_model(robot()), robot(), [_waving(one) for one in told])


def _waving(one):
    samples = one.channels[Channel.VOLTAGE]
    value = np.round((5.0 + 0.2 * np.sin(3.0 * samples.t_s)) / samples.quantum) * samples.quantum
    channels = {**one.channels, Channel.VOLTAGE: replace(samples, value=value)}
    replay = without_supply(one.replay)
    events = np.concatenate([replay.events, supply_events(samples.t_s, value)])
    events = events[np.argsort(events[:, 0], kind="stable")]
    return replace(one, channels=channels, replay=replace(replay, events=events))


def sag_of(model):
    plain = fit(model, Hypothesis(), np.zeros(len(model.nuisances)))
    knobs = effect_knobs(effect("voltage_sag"))
    start = np.append(plain.z, knobs[0].at(SOURCE_OHM))
    return fit(model, Hypothesis(knobs), start, plain.noise)


def test_a_register_that_shows_the_named_source_denies_nothing(sagging):
    model, _ = sagging
    named = named_source(model, sag_of(model))
    assert not named.contradicts
    value, deviation = named.motion
    assert value == pytest.approx(SOURCE_OHM, abs=3.0 * deviation)
    assert named.register[0] > 0.5 * SOURCE_OHM  # motions under a voltage that is late


def test_a_named_source_that_the_register_denies_is_taken_back(lying):
    found = sag_of(lying)
    gain = Gain("voltage_sag", found, 100.0, 1.0)
    why = objection(lying, found, gain, {})
    assert why is not None
    assert "the voltage register, read at the same time, shows 0.0" in why


def test_a_source_in_question_makes_the_voltage_of_a_replay_itself(sagging, lying):
    """What a register shows of it is late and rounded; other hypotheses have nothing better."""
    true, _ = sagging
    knobs = effect_knobs(effect("voltage_sag"))
    z = np.append(np.zeros(len(true.nuisances)), knobs[0].at(SOURCE_OHM))
    for hypothesis, vector, same in ((Hypothesis(knobs), z, True), (Hypothesis(), z[:-1], False)):
        one, other = (
            model.residuals(hypothesis, [vector], kinds=(Kind.POSITION,))[0][0, Kind.POSITION].value
            for model in (true, lying)
        )
        assert np.array_equal(one, other) == same
    ruled = lying.ruled().residuals(Hypothesis(knobs), [z], kinds=(Kind.POSITION,))[0]
    plain = lying.residuals(Hypothesis(), [z[:-1]], kinds=(Kind.POSITION,))[0]
    assert np.array_equal(ruled[0, Kind.POSITION].value, plain[0, Kind.POSITION].value)


def test_a_source_that_only_the_motion_asks_for_is_told_as_rejected(lying):
    plain = fit(lying, Hypothesis(), np.zeros(len(lying.nuisances)))
    (denied,) = supply_contradiction(lying, plain, plain, print)
    assert denied["effect"] == "voltage_sag"
    (wanted, wanted_error), (shown, _) = denied["from_motion_ohm"], denied["from_register_ohm"]
    assert wanted == pytest.approx(SOURCE_OHM, abs=3.0 * wanted_error)
    assert shown < 0.1 * SOURCE_OHM


def test_a_source_that_other_servos_draw_on_as_well_does_not_make_the_voltage_alone(lying):
    (servo,) = lying.robot.servos
    arm = JointModel(lying.base, lying.robot, lying.observed)
    arm.robot = replace(lying.robot, servos=(servo, replace(servo, joint="other")))
    knobs = effect_knobs(effect("voltage_sag"))
    z = np.append(np.zeros(len(arm.nuisances)), knobs[0].at(SOURCE_OHM))
    shared, plain = (
        arm.residuals(hypothesis, [vector], kinds=(Kind.POSITION,))[0][0, Kind.POSITION].value
        for hypothesis, vector in ((Hypothesis(knobs), z), (Hypothesis(), z[:-1]))
    )
    assert np.array_equal(shared, plain)
