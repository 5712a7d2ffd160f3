"""What a diagnosis of a whole robot gets to see, and who runs it."""

import json
import shutil

import pytest
from sealed_cases import small_proof

from bench.blind import Asked
from bench.proof.diagnosing import left_out
from bench.proof.plan import Planned
from bench.proof.rivals import chosen
from bench.proof.running import Proof
from bench.proof.staging import TOLD, of_robot, sight_of, stage
from busemu.tables import load_robot


@pytest.fixture
def case(tmp_path):
    """The public part of a case of a robot, as far as staging looks at it."""

    def made(name):
        folder = tmp_path / name
        (folder / "recordings").mkdir(parents=True)
        shutil.copy(load_robot(name).path, folder / "robot.toml")
        return folder

    return made


@pytest.mark.parametrize(
    ("name", "whole"),
    [("marvin", True), ("phantomx", True), ("marvin-leg", False), ("xl330-pendulum", False)],
)
def test_a_robot_on_legs_of_its_own_is_diagnosed_as_a_whole(case, name, whole):
    assert of_robot(case(name)) is whole


def test_what_is_deleted_from_a_robot_goes_with_all_that_is_one_with_it(case, tmp_path):
    folder = case("marvin")
    public = {"held_out": ["loaded"], "catalogue_without": ["foot_compliance"]}
    stage(folder, public, tmp_path / "stage", ())
    told = json.loads((tmp_path / "stage" / TOLD).read_text())
    assert told["without"] == ["foot_compliance", "ground_compliance"]
    assert told["held_out"] == ["loaded"]
    assert sight_of(folder).position_only
    assert sight_of(folder).legs


def test_a_small_catalogue_leaves_the_rest_out():
    known = ("backlash", "gain_error", "payload")
    assert left_out({"catalogue": [], "without": ["payload"]}, known) == ["payload"]
    told = {"catalogue": ["gain_error", "payload"], "without": ["payload"]}
    assert left_out(told, known) == ["backlash", "payload"]


def test_other_methods_and_further_experiments_are_of_the_joints_alone(tmp_path):
    joint = small_proof(tmp_path / "proof").planned
    robot = Planned("robot-0001", 7, Asked("null", rig="marvin-walk"))
    proof = Proof(tmp_path / "proof", (robot, *joint))
    for planned in proof.planned:
        (proof.cases / planned.name).mkdir(parents=True)
    assert proof.had == ("robot-0001", "case-0001", "case-0002")
    assert proof.joints == ("case-0001", "case-0002")
    assert chosen(proof, 1) == ["case-0001"]
