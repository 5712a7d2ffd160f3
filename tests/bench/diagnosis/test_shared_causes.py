"""What an arm has once and several joints found: one cause, and a number that all agree to."""

import pytest

from bench.diagnosis.joint.improved import _of_arm
from bench.diagnosis.joint.shared import mean, united
from bench.diagnosis.result import Cause, Estimate, Rival
from sim.effects import effect
from sim.model import Addition
from sim.model import Estimate as Known


def cause(effect, joint, value, half, **more):
    parameters = {"mass_kg": Estimate(value, (value - half, value + half), "kg")}
    told = {"held_out_gain_nats": 10.0, "explained_share": 0.5, "probability": 0.9}
    return Cause(effect, (joint,), parameters, **(told | more))


def test_joints_that_agree_make_a_number_surer():
    value, (low, high) = mean([0.03, 0.03], [(0.02, 0.04), (0.02, 0.04)])
    assert value == pytest.approx(0.03)
    assert high - low == pytest.approx(0.02 / 2**0.5)


def test_the_surer_joint_counts_for_more():
    value, _ = mean([0.02, 0.05], [(0.018, 0.022), (0.046, 0.054)])
    assert value == pytest.approx((4 * 0.02 + 0.05) / 5)


def test_joints_that_disagree_make_it_as_unsure_as_they_differ():
    """Three joints of a leg told a weight of 25.3 g as 36.6, 40.3 and 26.9 g."""
    found, halves = (0.0366, 0.0403, 0.0269), (0.0068, 0.0072, 0.0055)
    intervals = [(x - h, x + h) for x, h in zip(found, halves, strict=True)]
    value, (low, high) = mean(found, intervals)
    assert low < 0.0253 < high
    alone = sum(h**-2 for h in halves) ** -0.5
    assert 0.5 * (high - low) > 1.5 * alone
    assert value == pytest.approx(0.0332, abs=5e-4)


def test_a_weight_that_several_joints_found_is_one():
    every = [
        cause("payload", "coxa", 0.03, 0.01, held_out_gain_nats=20.0, probability=0.8),
        cause("coulomb_friction", "femur", 0.03, 0.01),
        cause("payload", "tibia", 0.03, 0.01, explained_share=0.9),
        cause("coulomb_friction", "tibia", 0.03, 0.01),
    ]
    found = united(every, {"coxa": 3.0, "femur": 5.0, "tibia": 1.0})
    friction, other, one = found
    assert (friction, other) == (every[1], every[3])
    assert (one.effect, one.scope) == ("payload", ("coxa", "tibia"))
    assert one.held_out_gain_nats == 30.0
    assert one.probability == 0.9
    assert one.explained_share == pytest.approx((3.0 * 0.5 + 1.0 * 0.9) / 4.0)
    assert one.parameters["mass_kg"].value == pytest.approx(0.03)


def test_joints_that_disagree_however_much_tell_no_weight_below_nothing():
    every = [cause("payload", "coxa", 0.01, 0.005), cause("payload", "tibia", 0.08, 0.005)]
    (one,) = united(every, {"coxa": 1.0, "tibia": 1.0})
    low, high = one.parameters["mass_kg"].ci95
    assert low == 0.0
    assert high > 0.08


def test_what_is_as_likely_must_be_so_at_every_joint():
    rivals = {
        "coxa": (Rival("link_mass", ("coxa",), 0.3, 1.0), Rival("com_offset", ("coxa",), 0.1, 2.0)),
        "tibia": (Rival("link_mass", ("tibia",), 0.2, 3.0),),
    }
    every = [
        cause("payload", joint, 0.03, 0.01, indistinguishable_from=some)
        for joint, some in rivals.items()
    ]
    (one,) = united(every, dict.fromkeys(rivals, 1.0))
    (rival,) = one.indistinguishable_from
    assert (rival.effect, rival.scope) == ("link_mass", ("coxa", "tibia"))
    assert (rival.probability, rival.behind_nats) == (0.2, 3.0)


def test_a_weight_of_one_joint_is_as_it_found_it():
    alone = cause("payload", "coxa", 0.03, 0.01)
    assert united([alone], {"coxa": 1.0}) == (alone,)


@pytest.mark.parametrize(
    ("masses", "told"),
    [((0.02, 0.02, 0.05), 0.03), ((0.02, 0.03), 0.025), ((0.02,), None)],
)
def test_the_better_model_has_the_number_that_is_told(masses, told):
    """If most of the three joints found it; of fewer, what the middle one has: nothing."""
    made = [
        Addition(effect("payload"), (), {"mass_kg": Known(m, "a test", (m - 0.01, m + 0.01))})
        for m in masses
    ]
    found = [one.estimates["mass_kg"] for one in _of_arm(made, 3)]
    assert [one.value for one in found] == ([] if told is None else [pytest.approx(told)])
    assert all(low < one.value < high for one in found for low, high in [one.ci95])
