import tomllib
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from walking_robots import believed, marvin

from bench.diagnosis.result import Estimate
from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.improved import (
    knob_of,
    of_causes,
    of_nuisances,
    of_room,
    of_settings,
    where_recorded,
    with_all,
    write_model,
)
from bench.diagnosis.robot.nuisances import LATE, nuisances, replayable, trials, with_nuisances
from busemu.tables import load_robot
from sim.model import read_model

TOLD = "fitted to recordings walk-1"
#: nuisances of the reading or of the room: no robot's file has them
NOT_THE_ROBOTS = ("reading", "sampling", "turn", "tilt", "turning")


def every():
    return nuisances(believed(), 0.005)


def only(name, deviations):
    return [deviations if n.name == name else 0.0 for n in every()]


@pytest.mark.parametrize(
    "word", ["zero", "mass", "centre", "supply", "gain", "late", "grip", "tips", "rotors"]
)
def test_a_nuisance_in_the_file_does_what_its_trial_did(word):
    for nuisance in every():
        if nuisance.name.split()[0] != word:
            continue
        (trial,) = (t for t in trials(believed()) if t.name == nuisance.trial)
        deviations = trial.size / nuisance.deviation
        added = of_nuisances(believed(), every(), only(nuisance.name, deviations), TOLD)
        assert with_all(believed(), added) == trial.change(believed(), trial.size), nuisance.name


@pytest.mark.parametrize("word", ["torque", "friction"])
def test_a_joints_own_nuisance_changes_that_joint_only(word):
    nuisance = next(n for n in every() if n.name == f"{word} leg3.femur")
    (trial,) = (t for t in trials(believed()) if t.name == nuisance.trial)
    added = of_nuisances(
        believed(), every(), only(nuisance.name, trial.size / nuisance.deviation), TOLD
    )
    changed = with_all(believed(), added)
    for before, own, all_of_kind in zip(
        believed().joints, changed.joints, trial.change(believed(), trial.size).joints, strict=True
    ):
        expected = all_of_kind if own.name == "leg3.femur" else before
        assert own.drive.friction.coulomb_nm == pytest.approx(expected.drive.friction.coulomb_nm)
        assert own.drive.torque_constant_nm_a == pytest.approx(expected.drive.torque_constant_nm_a)


@pytest.mark.parametrize("word", ["motors", "gears"])
def test_what_all_joints_have_in_common_changes_all_of_them(word):
    (nuisance,) = (n for n in every() if n.name == word)
    (trial,) = (t for t in trials(believed()) if t.name == word)
    added = of_nuisances(believed(), every(), only(word, trial.size / nuisance.deviation), TOLD)
    wanted = trial.change(believed(), trial.size)
    for own, expected in zip(with_all(believed(), added).joints, wanted.joints, strict=True):
        assert own.drive.friction.coulomb_nm == pytest.approx(expected.drive.friction.coulomb_nm)
        assert own.drive.torque_constant_nm_a == pytest.approx(expected.drive.torque_constant_nm_a)
        assert own.drive != believed().joints[0].drive


@pytest.mark.parametrize("late", [1.0, -1.0])
def test_the_file_where_it_was_recorded_is_the_robot_that_was_replayed(late):
    z = np.random.default_rng(3).normal(0.0, 0.8, len(every()))
    z = np.clip(z, *np.array([n.ends for n in every()]).T)
    z[[n.name for n in every()].index(LATE)] = late
    wanted = with_nuisances(believed(), every(), replayable(every(), z).tolist())
    told = with_all(believed(), of_nuisances(believed(), every(), z.tolist(), TOLD))
    found = where_recorded(told, every(), z.tolist())
    for own, expected in zip(found.joints, wanted.joints, strict=True):
        one, other = own.drive.friction, expected.drive.friction
        assert one.coulomb_nm == pytest.approx(other.coulomb_nm)
        assert one.viscous_nm_s_rad == pytest.approx(other.viscous_nm_s_rad)
        assert replace(own.drive, friction=other) == expected.drive
    assert replace(found, joints=wanted.joints) == wanted


def test_an_effect_that_a_nuisance_is_has_a_knob_at_which_it_is_that():
    known, none = placed_effects(believed()), []
    for nuisance in every():
        deviations = nuisance.ends[1]
        for name in nuisance.same:
            knob = knob_of(believed(), known[name], nuisance, deviations)
            if knob is None:
                none.append(name)
                continue
            z = only(nuisance.name, deviations)
            wanted = with_nuisances(believed(), every(), z)
            found = known[name].apply(believed(), known[name].knob.value(knob))
            own = [leg.foot.stiffness_n_m for leg in found.legs]
            assert own == pytest.approx([leg.foot.stiffness_n_m for leg in wanted.legs]), name
            if "foot_compliance" not in name:  # whose damping is typical
                assert_alike(found, wanted)
    assert none == ["payload@all", "punch@all"]


def assert_alike(found, wanted):
    one, other = flat(found), flat(wanted)
    assert one.keys() == other.keys()
    apart = [k for k, x in one.items() if isinstance(x, float) and x != pytest.approx(other[k])]
    assert apart == []


def flat(value, path=""):
    if is_dataclass(value):
        value = {f.name: getattr(value, f.name) for f in fields(value)}
    if isinstance(value, tuple):
        value = dict(enumerate(value))
    if isinstance(value, dict):
        return {k: v for name, x in value.items() for k, v in flat(x, f"{path}.{name}").items()}
    return {path: value}


def test_every_nuisance_that_is_the_robots_is_in_its_file():
    for nuisance in every():
        if nuisance.name.split()[0] not in NOT_THE_ROBOTS:
            assert of_nuisances(believed(), every(), only(nuisance.name, 2.0), TOLD), nuisance.name


@pytest.mark.parametrize("word", NOT_THE_ROBOTS)
def test_what_is_not_the_robots_own_is_not_in_its_file(word):
    names = [n.name for n in every() if n.name.split()[0] == word]
    assert names
    for name in names:
        assert of_nuisances(believed(), every(), only(name, 2.0), TOLD) == []


def test_what_is_as_believed_is_left_so_and_little_is_told_as_well():
    assert of_nuisances(believed(), every(), [0.0 for _ in every()], TOLD) == []
    (told,) = of_nuisances(believed(), every(), only("torque leg3.femur", 0.01), TOLD)
    assert told.where == ("leg3.femur",)


def test_the_rooms_tilt_is_that_of_its_trial():
    (trial,) = (t for t in trials(believed()) if t.name == "tilt pitch")
    (nuisance,) = (n for n in every() if n.name == "tilt pitch")
    room = of_room(every(), only("tilt pitch", trial.size / nuisance.deviation))
    tilted = with_all(believed(), room)
    assert np.allclose(
        [tilted.ground.pitch_rad, tilted.ground.roll_rad],
        [g := trial.change(believed(), trial.size).ground.pitch_rad, 0.0],
    ), g


def test_a_model_file_is_the_robot_with_its_causes_and_says_where_from(tmp_path):
    placed = placed_effects(believed())["foot_compliance@leg2"]
    value = 900.0
    found = {placed.parameter.name: Estimate(value, (800.0, 1000.0), "N/m")}
    write_model(marvin(), of_causes([(placed, found)], TOLD), tmp_path / "model.toml")
    loaded = read_model(load_robot(tmp_path / "model.toml"))
    assert loaded.legs == placed.apply(believed(), value).legs
    assert replace(loaded, legs=believed().legs) == believed()
    with (tmp_path / "model.toml").open("rb") as file:
        (entry,) = tomllib.load(file)["effect"]
    assert entry["where"] == ["leg2"]
    assert entry["parameters"][placed.parameter.name]["ci95"] == [800.0, 1000.0]
    assert all(TOLD in p["source"] for p in entry["parameters"].values())
    assert "assumed" in entry["parameters"]["damping_n_s_m"]["source"]


@pytest.mark.parametrize("name", ["foot_compliance@all", "ground_tilt.pitch@all", "backlash@leg2"])
def test_an_effect_at_a_value_of_its_knob_is_what_was_replayed(name):
    known = placed_effects(believed())
    z = 2.0 * known[name].first_z
    added = of_settings(known, ((name, z),), TOLD)
    assert with_all(believed(), added) == known[name].apply(believed(), known[name].knob.value(z))


def test_gears_are_looked_at_in_the_joints_that_carry_the_robot_together():
    known = placed_effects(believed())
    carrying = [j.name for j in believed().joints if j.segment != "coxa"]
    assert sorted(known["joint_compliance@femur+tibia"].where) == sorted(carrying)
    assert "backlash@femur+tibia" in known
    assert "coulomb_friction@femur+tibia" not in known


def test_a_floor_of_three_quarters_of_its_grip_is_no_tolerance():
    (grip,) = [n for n in every() if n.name == "grip"]
    low, high = np.multiply(grip.ends, grip.deviation)
    assert low == -high
    assert 0.20 < high < 0.25  # what two engines differ by, 0.20 at most, and not much more
    assert grip.same == ("foot_slip@all",)
