"""What counts as right of a robot: joints, phases and names, by docs/proof/rules.md."""

import pytest
from judged_cases import hidden_in, judged, mismatch, placed, robot_diagnosis, robot_key, tells

from bench.blind.drafts import parameters
from bench.blind.legged_effects import LEGGED, Where
from bench.blind.legged_sizing import believed
from bench.blind.scenes import SCENES
from bench.proof.places import f1, joints_of, phase_of
from bench.proof.truths import ROBOT_TABLE, true_parameters
from sim.effects import catalogue
from sim.model import read_model

EVERY = SCENES["marvin-walk"].joints
TIBIAS = [joint for joint in EVERY if joint.endswith(".tibia")]
LEG1 = [joint for joint in EVERY if joint.startswith("leg1.")]
LEGS = tuple(f"leg{n}" for n in range(1, 7))
MASS = hidden_in("link_mass", TIBIAS, factor=(1.5, 1.0))
SOFT = hidden_in("foot_compliance", EVERY, stiffness_n_m=(1500.0, None))
GAIN = hidden_in("gain_error", EVERY, ratio=None, factor=(1.2, 1.0))


def test_joints_of_a_cause_are_those_of_its_legs_its_bodies_or_all():
    assert joints_of(["leg1"], EVERY) == set(LEG1)
    assert joints_of(TIBIAS, EVERY) == set(TIBIAS)
    assert joints_of(["trunk"], EVERY) == set(EVERY)
    assert joints_of([], EVERY) == set(EVERY)  # of a cause that is in the whole robot


def test_f1_is_the_harmonic_mean_of_precision_and_recall():
    told, true = {"a", "b", "c"}, {"b", "c", "d", "e"}
    precision, recall = 2 / 3, 2 / 4
    assert f1(told, true) == pytest.approx(2 * precision * recall / (precision + recall))
    assert f1(true, true) == 1.0
    assert f1(set(), true) == 0.0


def test_the_joints_of_the_named_causes_are_compared_with_the_true_ones():
    right = judged(robot_key("single", MASS), robot_diagnosis(placed("link_mass", TIBIAS)))
    assert right.robot
    assert right.first_exact
    assert right.place.f1 == 1.0
    assert not right.place.everywhere
    leg = judged(robot_key("single", MASS), robot_diagnosis(placed("link_mass", ["leg1.tibia"])))
    assert leg.first_exact
    assert leg.place.f1 == pytest.approx(2 / 7)  # one of six, and nothing else
    wrong = judged(robot_key("single", MASS), robot_diagnosis(placed("payload")))
    assert not wrong.first_right
    assert wrong.place.f1 == pytest.approx(2 * 6 / (18 + 6))


def test_where_nothing_is_named_the_joints_of_the_mismatch_count():
    places = [mismatch(TIBIAS[:3], "stance"), mismatch(TIBIAS[:4], "swing")]
    silent = robot_diagnosis(places=places, verdict="unexplained")
    case = judged(robot_key("deleted", MASS), silent)
    assert case.place.f1 == case.place.mismatch_f1 == pytest.approx(2 * 4 / (4 + 6))
    nothing = judged(robot_key("single", MASS), robot_diagnosis())
    assert (nothing.place.f1, nothing.place.told_phase) == (0.0, "")
    failed = judged(robot_key("single", MASS), None, failure="took too long")
    assert failed.place.f1 == 0.0
    assert not failed.place.phase_right


def test_an_ordinary_misfit_is_among_the_true_joints_of_the_mismatch_not_of_the_causes():
    masked = robot_key("single", MASS, ordinary=[GAIN])
    told = robot_diagnosis(
        placed("gain_error"), placed("link_mass", TIBIAS), places=[mismatch(EVERY, "stance")]
    )
    case = judged(masked, told)
    assert [n.label for n in case.named] == ["ordinary", "hidden"]
    assert case.place.f1 == case.place.mismatch_f1 == 1.0
    only = judged(masked, robot_diagnosis(placed("gain_error"), places=[mismatch(EVERY, "stance")]))
    assert not only.first_right
    assert only.place.f1 == 1.0  # of the mismatch: what is hidden was not named


@pytest.mark.parametrize(
    ("share", "phase"),
    [(1.0, "stance"), (0.7, "stance"), (0.6, "all"), (0.4, "all"), (0.3, "swing"), (0.0, "swing")],
)
def test_a_misfit_is_of_a_phase_that_has_twice_what_the_other_has(share, phase):
    assert phase_of(share) == phase


def test_the_phase_that_is_told_is_compared_with_the_true_one():
    stance = [mismatch(TIBIAS, "stance", 0.6), mismatch(LEG1, "swing", 0.1)]
    both = [mismatch(TIBIAS, "stance", 0.4), mismatch(TIBIAS, "swing", 0.4)]
    for places, told in ((stance, "stance"), (both, "all"), ([], "")):
        for share, true in ((0.9, "stance"), (0.5, "all"), (0.1, "swing")):
            key = robot_key("single", MASS, stance_share=share)
            place = judged(key, robot_diagnosis(places=places, verdict="unexplained")).place
            assert (place.told_phase, place.true_phase) == (told, true)
            assert place.phase_right is (told == true)


def test_one_name_at_several_places_is_one_cause():
    soft = hidden_in("joint_compliance", TIBIAS, stiffness_nm_rad=(4.0, 12.0))
    told = robot_diagnosis(
        placed("joint_compliance", TIBIAS[:2], compliance_rad_nm=(0.17, 0.1, 0.2)),
        placed("joint_compliance", TIBIAS[2:], 0.9, compliance_rad_nm=(0.3, 0.2, 0.4)),
    )
    case = judged(robot_key("single", soft), told)
    assert case.set_right
    assert case.place.f1 == 1.0
    (checked,) = case.checked
    assert checked.value == 0.17  # of the first
    assert checked.true == pytest.approx(1 / 4 - 1 / 12)
    assert checked.covered


def test_a_soft_floor_and_soft_tips_are_one_only_where_all_legs_have_them():
    named = robot_diagnosis(placed("ground_compliance"))
    assert judged(robot_key("single", SOFT), named).first_right
    assert not judged(robot_key("single", SOFT), named).first_exact
    one_leg = robot_key(
        "single", hidden_in("foot_compliance", LEG1, stiffness_n_m=(1500.0, None))
    ) | {"concealment": "rare"}
    assert not judged(one_leg, named).first_right


def test_a_null_of_a_robot_has_no_place():
    case = judged(robot_key("null", stance_share=None), robot_diagnosis())
    assert case.place is None
    assert not case.alarms


def told(name, size, sign=1, scene="marvin-walk"):
    _, truth = LEGGED[name].apply(believed(SCENES[scene]), size, Where(sign, LEGS))
    return {"effect": name, "parameters": parameters(truth)}


@pytest.mark.parametrize("scene", ["marvin-walk", "phantomx-walk"])
@pytest.mark.parametrize("name", LEGGED)
def test_what_is_hidden_in_a_robot_is_told_in_the_catalogues_words(name, scene):
    tells(told(name, LEGGED[name].typical, scene=scene), scene)


def test_every_effect_that_can_be_hidden_in_a_robot_is_in_the_table():
    assert set(ROBOT_TABLE) == set(LEGGED)


def test_quantities_of_robots_count_from_what_the_file_has():
    def main(name, size, sign=1):
        found = true_parameters(told(name, size, sign), "marvin-walk")
        return next(iter(found.values())).value

    base = read_model(SCENES["marvin-walk"].robot)
    softer = catalogue()["joint_compliance"].apply(
        base, TIBIAS, {"compliance_rad_nm": main("joint_compliance", 0.2), "damping_nm_s_rad": 0.0}
    )
    stiffness = {j.name: j.drive.gear_stiffness_nm_rad for j in softer.joints}
    said = told("joint_compliance", 0.2)["parameters"]["stiffness_nm_rad"]["value"]
    assert stiffness[TIBIAS[0]] == pytest.approx(said)
    assert main("voltage_sag", 0.5) == pytest.approx(0.5)
    assert main("foot_slip", 0.4) == pytest.approx(0.6)
    assert main("supply_voltage", 0.1, -1) == pytest.approx(0.87)
    assert main("link_mass", 2.0, -1) == pytest.approx(1 / 3.05)


def test_a_link_is_never_lighter_than_nothing():
    for sign in (1, -1):
        whole, _ = LEGGED["link_mass"].apply(
            believed(SCENES["marvin-walk"]), LEGGED["link_mass"].most, Where(sign, LEGS)
        )
        assert min(whole.body.link_mass.values()) > 0.0
