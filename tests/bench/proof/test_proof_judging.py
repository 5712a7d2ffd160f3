"""What counts as right: the rules of docs/proof/rules.md, one by one."""

import pytest
from judged_cases import cause, diagnosis, effect, judged, key

from bench.proof.equivalence import ALIKE, Sight, same
from bench.proof.judging import _sight
from sim.effects import catalogue

BACKLASH = effect("backlash", width_rad=(0.02, 0.0))
DELAY = effect("transport_delay", delay_s=(0.02, 0.0))
GAIN = effect("gain_error", ratio=float("nan"), factor=(1.2, 1.0))


def test_the_effects_own_name_is_right():
    case = judged(key("single", BACKLASH), diagnosis(cause("backlash")))
    assert case.first_exact
    assert case.first_right
    assert case.set_right
    assert not case.certain_and_wrong


def test_another_name_is_wrong_and_with_certainty_worse():
    case = judged(key("single", BACKLASH), diagnosis(cause("dead_zone", 0.95)))
    assert not case.first_right
    assert not case.second_right
    assert [n.label for n in case.named] == ["wrong"]
    assert case.certain_and_wrong
    unsure = judged(key("single", BACKLASH), diagnosis(cause("dead_zone", 0.9)))
    assert not unsure.certain_and_wrong
    partly = diagnosis(cause("dead_zone"), verdict="partly_explained")
    assert not judged(key("single", BACKLASH), partly).certain_and_wrong


@pytest.mark.parametrize(("style", "right"), [("position", True), ("fast", False), ("slow", False)])
def test_an_effect_that_is_the_same_in_such_data_is_right_by_class_not_by_name(style, right):
    case = judged(key("single", DELAY, style=style), diagnosis(cause("read_skew")))
    assert case.first_right is right
    assert case.set_right is right
    assert not case.first_exact
    assert not case.set_exact


@pytest.mark.parametrize(("rig", "right"), [("xl330-turntable", True), ("xl330-pendulum", False)])
def test_masses_are_one_without_gravity(rig, right):
    mass = effect("link_mass", factor=(1.3, 1.0))
    case = judged(key("single", mass, rig=rig), diagnosis(cause("rotor_inertia")))
    assert case.first_right is right


def test_a_small_stated_class_with_the_truth_is_right_by_class():
    small = cause("dead_zone", rivals=[("backlash", 0.3), ("joint_compliance", 0.1)])
    case = judged(key("single", BACKLASH), diagnosis(small))
    assert case.first_right
    assert not case.first_exact
    assert [n.label for n in case.named] == ["wrong"]
    rest = [("backlash", 0.2), ("joint_compliance", 0.3), ("punch", 0.1)]
    assert not judged(
        key("single", BACKLASH), diagnosis(cause("dead_zone", rivals=rest))
    ).first_right


def test_the_second_guess_is_the_likeliest_rival_or_else_the_next_cause():
    rivals = [("coulomb_friction", 0.1), ("backlash", 0.2), ("punch", 0.1), ("cable_drag", 0.01)]
    case = judged(key("single", BACKLASH), diagnosis(cause("dead_zone", rivals=rivals)))
    assert (case.first_right, case.second_right) == (False, True)
    two = diagnosis(cause("dead_zone"), cause("backlash"))
    assert judged(key("single", BACKLASH), two).second_right
    third = diagnosis(cause("dead_zone"), cause("cable_drag"), cause("backlash"))
    assert not judged(key("single", BACKLASH), third).second_right


def test_naming_the_ordinary_misfit_is_true_but_not_the_answer():
    masked = key("single", BACKLASH, ordinary=[GAIN])
    case = judged(masked, diagnosis(cause("gain_error"), cause("backlash")))
    assert case.first_exact
    assert case.set_exact
    assert [n.label for n in case.named] == ["ordinary", "hidden"]
    only = judged(masked, diagnosis(cause("gain_error")))
    assert not only.first_right
    assert not only.wrong
    assert not only.set_right


def test_each_truth_answers_for_one_cause_its_own_name_first():
    punch = effect("punch", duty=(0.02, 0.0))
    case = judged(key("single", punch), diagnosis(cause("dead_zone"), cause("punch")))
    assert [n.label for n in case.named] == ["wrong", "hidden"]
    assert not case.set_right


def test_a_full_set_is_all_and_nothing_else():
    pair = key("pair", BACKLASH, DELAY)
    assert judged(pair, diagnosis(cause("transport_delay"), cause("backlash"))).set_exact
    assert not judged(pair, diagnosis(cause("backlash"))).set_right
    more = diagnosis(cause("backlash"), cause("transport_delay"), cause("punch"))
    assert not judged(pair, more).set_right


@pytest.mark.parametrize("kind", ["deleted", "stranger"])
def test_what_is_in_no_catalogue_is_rightly_unexplained_and_never_named(kind):
    hidden = effect("backlash" if kind == "deleted" else "cogging")
    unknown = judged(key(kind, hidden), diagnosis(verdict="unexplained"))
    assert unknown.says_unknown
    assert not unknown.wrong
    named = judged(key(kind, hidden), diagnosis(cause("backlash"), verdict="partly_explained"))
    assert not named.says_unknown
    assert named.wrong
    silent = judged(key(kind, hidden), diagnosis())
    assert not silent.says_unknown
    masked = key(kind, hidden, ordinary=[GAIN])
    partly = diagnosis(cause("gain_error"), verdict="partly_explained")
    assert judged(masked, partly).says_unknown


def test_any_word_on_a_null_is_a_false_alarm_and_a_failure_too():
    assert not judged(key("null"), diagnosis()).alarms
    assert judged(key("null"), diagnosis(verdict="unexplained")).alarms
    assert judged(key("null"), None, failure="took too long").alarms


def test_the_smallest_effect_gives_the_size_of_a_case():
    pair = key("pair", effect("backlash", 5.0), effect("punch", 2.0))
    assert judged(pair, diagnosis()).ratio == 2.0


def test_the_share_is_of_what_could_be_explained_on_held_out_recordings():
    # before 1e-4, after 4e-6, oracle 1e-6: (100 - 4) / (100 - 1)
    case = judged(key("single", BACKLASH), diagnosis(cause("backlash"), before=1e-2, after=2e-3))
    assert case.explained == pytest.approx(96 / 99)
    worse = diagnosis(cause("backlash"), before=1e-2, after=1.0)
    assert judged(key("single", BACKLASH), worse).explained == -1.0
    little = diagnosis(cause("backlash"), before=1.4e-3, after=1e-3)  # 0.96e-6 below the floor
    assert judged(key("single", BACKLASH), little).explained is None


def test_parameters_are_checked_where_the_name_is_right():
    right = diagnosis(cause("backlash", width_rad=(0.021, 0.0205, 0.0215)))
    (checked,) = judged(key("single", BACKLASH), right).checked
    assert checked.main
    assert checked.error == pytest.approx(0.05)
    assert checked.covered is False
    gain = effect("gain_error", factor=(1.2, 1.0))
    (checked,) = judged(
        key("single", gain), diagnosis(cause("gain_error", scale=(1.25, 1.1, 1.4)))
    ).checked
    assert checked.error == pytest.approx(0.25)  # of how far 1.2 is from off
    assert checked.covered is True
    assert judged(key("single", BACKLASH), diagnosis(cause("punch"))).checked == ()


def test_a_class_has_the_probability_of_its_members():
    rivals = [("punch", 0.3), ("backlash", 0.1)]
    case = judged(key("single", effect("punch")), diagnosis(cause("dead_zone", 0.5, rivals=rivals)))
    assert case.named[0].probability == 0.5
    assert case.named[0].class_probability == pytest.approx(0.8)


def test_classes_are_of_effects_of_the_catalogue():
    assert {name for alike in ALIKE for name in alike.effects} <= set(catalogue())


def test_an_effect_is_the_same_as_itself_and_classes_do_not_run_into_each_other():
    sights = [Sight(p, u) for p in (False, True) for u in (False, True)]
    for sight in (*sights, Sight(position_only=False, upright=False, no_duty=True)):
        for name in catalogue():
            own = same(name, sight)
            assert name in own
            assert all(same(other, sight) == own for other in own)


@pytest.mark.parametrize(
    ("style", "one"),
    [
        (None, {"gain_error", "supply_voltage", "torque_constant"}),
        ("position", {"gain_error", "supply_voltage", "torque_constant"}),
        ("position and voltage", {"gain_error", "torque_constant"}),
        ("position, voltage and load", {"gain_error"}),
    ],
)
def test_a_voltage_that_a_robot_read_tells_a_supply_from_a_gain(style, one):
    told = {"rig": "marvin-walk", "concealment": "plain"} | ({"style": style} if style else {})
    sight = _sight(told)
    assert same("gain_error", sight) == one
    assert same("torque_limit", sight) == (
        {"torque_limit"} if "voltage" in str(style) else {"torque_limit", "voltage_sag"}
    )
    late = {"read_skew"} if "load" in str(style) else {"transport_delay", "read_skew"}
    assert same("read_skew", sight) == late


def test_the_centre_of_a_trunk_is_no_zero_of_a_joint():
    assert same("com_offset", Sight(False, False)) == {"com_offset", "zero_offset"}
    told = {"rig": "marvin-walk", "concealment": "plain"}
    assert same("com_offset", _sight(told)) == {"com_offset"}
