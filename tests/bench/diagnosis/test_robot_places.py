from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.noise import Block
from bench.diagnosis.robot.diagnosis import Work
from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.features import RobotKind
from bench.diagnosis.robot.nuisances import LATE
from bench.diagnosis.robot.places import LEAST, mismatch, moved
from busemu.tables import load_robot
from sim.model import read_model

JOINTS = [f"leg{n}.{part}" for n in (1, 2, 3) for part in ("coxa", "femur", "tibia")]
BINS = 24
TOLD_TO_STAND = np.tile(np.arange(BINS) < 14, len(JOINTS))
PRESSED = np.tile(np.where(np.arange(BINS) < 13, 1.0, 0.0), len(JOINTS))  #: it lifts its foot early
PRESSED[12::BINS] = 0.5
STANCE, SWING = PRESSED == 1.0, PRESSED == 0.0
NOISE_RAD = 1e-3


class Stood:
    """A model of one recording."""

    def __init__(self):
        self.base = SimpleNamespace(joints=[SimpleNamespace(name=name) for name in JOINTS])
        row = np.repeat(np.arange(len(JOINTS)), BINS)
        self.features = [SimpleNamespace(joint_row=row, stance=TOLD_TO_STAND)]

    def floors(self):
        return {RobotKind.JOINTS: NOISE_RAD}

    def block(self, r, kind, value):
        t = np.arange(len(value)) * 1.0
        return Block(t, value, 0.0 * t)

    def pressed(self, r):
        return PRESSED


def told(value):
    return mismatch(Stood(), {0: value})


def shifted(value):
    return moved(Stood(), {0: value})


def noise(seed=5):
    return np.random.default_rng(seed).normal(0.0, NOISE_RAD, STANCE.size)


def rows_of(joints):
    return np.repeat([name in joints for name in JOINTS], BINS)


def test_what_lasts_by_chance_makes_less_of_what_a_joint_is_off_all_along():
    """A robot that stands may be ten times as far off as noise has it, for as long as it does."""
    off = noise() + 4.0 * NOISE_RAD * rows_of(["leg2.femur"])
    plain = told(off)
    sways = 10.0 * NOISE_RAD * np.ones((len(off), 1))
    stood = Stood()
    stood.block = lambda r, kind, value: replace(Stood().block(r, kind, value), sways=sways)
    swayed = mismatch(stood, {0: off})
    assert plain[0]["joints"] == ["leg2.femur"]
    assert min(place["p_value"] for place in plain) < 1e-6
    assert min((place["p_value"] for place in swayed), default=1.0) > 0.5


def test_joints_of_one_kind_that_are_off_in_stance_stand_together():
    femurs = [name for name in JOINTS if name.endswith("femur")]
    (place,) = told(noise() + 0.01 * (rows_of(femurs) & STANCE))
    assert (place["joints"], place["phase"]) == (femurs, "stance")
    assert 0.9 < place["share"] <= 1.0
    assert place["p_value"] < 1e-6


def test_a_leg_that_stands_out_stands_on_its_own():
    value = noise() + 0.02 * (rows_of(["leg2.tibia"]) & SWING)
    (place,) = told(value)
    assert (place["joints"], place["phase"]) == (["leg2.tibia"], "swing")


def test_what_is_too_little_in_each_joint_of_a_kind_is_told_where_it_is_in_all():
    femurs = [name for name in JOINTS if name.endswith("femur")]
    little = 1.7 * NOISE_RAD * STANCE
    assert told(noise() + little * rows_of(femurs[:1])) == ()
    (place,) = told(noise() + little * rows_of(femurs))
    assert (place["joints"], place["phase"]) == (femurs, "stance")
    assert place["p_value"] < 0.05


def test_legs_beside_one_that_stands_out_are_not_told_for_it():
    femurs = [name for name in JOINTS if name.endswith("femur")]
    much = 0.02 * (rows_of(femurs[1:2]) & STANCE)
    (alone,) = told(noise() + much)
    assert alone["joints"] == ["leg2.femur"]
    both = told(noise() + much + 2.0 * NOISE_RAD * (rows_of(femurs[::2]) & STANCE))
    assert [place["joints"] for place in both] == [["leg2.femur"], ["leg1.femur", "leg3.femur"]]


def test_a_joint_of_a_kind_that_is_not_off_is_not_told_with_the_others():
    femurs = [name for name in JOINTS if name.endswith("femur")]
    quiet = ~rows_of(["leg3.femur"]) | ~STANCE
    (place,) = told((noise() + 5.0 * NOISE_RAD * (rows_of(femurs) & STANCE)) * quiet)
    assert place["joints"] == femurs[:2]


def test_noise_has_no_place():
    assert [told(noise(seed)) for seed in range(20)] == [()] * 20


def test_shares_are_of_the_whole_misfit():
    value = noise() + 0.01 * (rows_of(["leg1.coxa"]) & STANCE)
    value += 0.01 * (rows_of(["leg3.tibia"]) & STANCE)
    found = told(value)
    assert {place["joints"][0] for place in found} == {"leg1.coxa", "leg3.tibia"}
    assert sum(place["share"] for place in found) == pytest.approx(1.0, abs=0.2)


def test_what_is_named_is_told_where_it_moves_joints_however_little():
    femurs = [name for name in JOINTS if name.endswith("femur")]
    (place,) = shifted(0.1 * NOISE_RAD * (rows_of(femurs) & STANCE))
    assert (place["joints"], place["phase"]) == (femurs, "stance")
    assert place["share"] == pytest.approx(1.0)
    assert place["p_value"] == pytest.approx(1.0)


@pytest.mark.parametrize("place", [told, shifted])
def test_places_are_told_by_where_feet_press_and_not_by_what_legs_are_told(place):
    femurs = [name for name in JOINTS if name.endswith("femur")]
    lifted_early = rows_of(femurs) & TOLD_TO_STAND & ~STANCE
    stance, swing = sorted(place(0.1 * lifted_early), key=lambda row: row["phase"])
    assert (stance["phase"], swing["phase"]) == ("stance", "swing")
    assert stance["share"] == pytest.approx(0.25)  # half of one bin, and another bin
    assert swing["share"] == pytest.approx(0.75)


def test_joints_that_a_named_effect_hardly_moves_are_not_told():
    one = 1.0 * (rows_of(["leg2.tibia"]) & SWING)
    others = rows_of([name for name in JOINTS if name.endswith("tibia")]) & SWING
    (place,) = shifted(0.01 * np.maximum(one, 0.9 * np.sqrt(LEAST) * others))
    assert place["joints"] == ["leg2.tibia"]
    (place,) = shifted(0.01 * np.maximum(one, 1.1 * np.sqrt(LEAST) * others))
    assert len(place["joints"]) == 3


def test_places_are_told_by_their_share_of_what_a_named_effect_moves():
    much = 4.0 * NOISE_RAD * (rows_of(["leg2.tibia"]) & SWING)
    little = NOISE_RAD * (rows_of(["leg1.femur"]) & STANCE)
    first, second = shifted(much + little)
    assert (first["joints"], second["joints"]) == (["leg2.tibia"], ["leg1.femur"])
    assert first["p_value"] < 1e-6
    assert second["p_value"] == pytest.approx(1.0)
    (place,) = shifted(much + 0.4 * little)
    assert place["joints"] == ["leg2.tibia"]


def named(name):
    return SimpleNamespace(name=name)


class Pushed(Stood):
    """A robot whose name pushes tibiae in stance, and whose gain moves coxae in swing."""

    def __init__(self, gain):
        super().__init__()
        self.nuisances = (gain, named("zero"))

    def recentre(self, settings, z, which):
        assert len(which) == 1

    def modelled(self, settings, z, r):
        tibiae, coxae = ([n for n in JOINTS if n.endswith(part)] for part in ("tibia", "coxa"))
        pushed = 0.01 * len(settings) * (rows_of(tibiae) & STANCE)
        return {RobotKind.JOINTS: pushed + 0.01 * z[0] * (rows_of(coxae) & SWING) + z[1]}


@pytest.mark.parametrize(
    ("name", "ends", "phases"),
    [
        ("gain", True, {"stance", "swing"}),
        ("gain", False, {"stance"}),
        (LATE, True, {"stance"}),  # neither of whose ends is a finding
    ],
)
def test_tolerances_at_their_ends_move_a_robot_as_names_do(name, ends, phases):
    one = named(name)
    after = SimpleNamespace(
        names=("push",), settings=(("push", 1.0),), nuisances=np.array([2.0, 1.0])
    )
    held = SimpleNamespace(at_ends=lambda fit: [one] if ends else [])
    work = SimpleNamespace(model=Pushed(one), held=held, which=[0])
    assert {place["phase"] for place in Work._mismatch(work, after)} == phases


class Paid(Pushed):
    """The same, recorded with that much of the gain, one tibia off by more, and little noise."""

    def __init__(self, gain, much, more):
        super().__init__(gain)
        self.truth = self.modelled((), np.array([much, 1.0]), 0)[RobotKind.JOINTS]
        self.truth = self.truth + more * rows_of(["leg2.tibia"]) + 0.1 * noise()

    def residuals(self, names, z, which):
        off = self.truth - self.modelled((), z, 0)[RobotKind.JOINTS]
        return {(0, RobotKind.JOINTS): SimpleNamespace(value=off)}


COXAE = {name for name in JOINTS if name.endswith("coxa")}


@pytest.mark.parametrize(
    ("much", "more", "at_end", "told"),
    [
        (2.0, 0.01, True, {"leg2.tibia", *COXAE}),  # what it takes, too
        (2.0, 0.01, False, {"leg2.tibia"}),
        (0.01, 0.0, True, COXAE),  # no more than noise: where it moves them
        (0.01, 0.0, False, set()),
    ],
)
def test_without_a_name_what_tolerances_at_their_ends_take_is_left(much, more, at_end, told):
    one = named("gain")
    after = SimpleNamespace(names=(), settings=(), nuisances=np.array([much, 1.0]))
    held = SimpleNamespace(at_ends=lambda fit: [one] if at_end else [])
    work = SimpleNamespace(model=Paid(one, much, more), held=held, which=[0])
    rows = Work._mismatch(work, after)
    assert {joint for row in rows for joint in row["joints"]} == told


def test_a_rotor_is_of_a_servo_and_not_of_where_it_sits():
    robot = read_model(load_robot("marvin"))
    leg = {"leg1", "leg1.tibia"}
    places = leg | {"all", "coxa", "femur", "tibia", "femur+tibia", "leg1.femur+tibia"}

    def placed(name, robot):
        return places & {key.partition("@")[2] for key in placed_effects(robot) if name in key}

    assert placed("rotor_inertia", robot) == leg | {"all"}
    assert placed("backlash", robot) == places
    first, *others = robot.joints
    other = replace(first.drive, rotor_inertia_kg_m2=2.0 * first.drive.rotor_inertia_kg_m2)
    unlike = replace(robot, joints=(replace(first, drive=other), *others))
    assert placed("rotor_inertia", unlike) == places
