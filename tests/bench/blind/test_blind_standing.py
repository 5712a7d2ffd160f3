"""Robots that stand: where their feet are, and which legs carry them."""

import numpy as np
import pytest

from bench.blind import Asked, legged_sizing
from bench.blind.drafts import LeggedDraft
from bench.blind.legged_case import draw_legged, stance_share
from bench.blind.scenes import SCENES, play
from bench.blind.standing import PLACES_M, STRETCH_RAD, ways
from bench.motions import STANDING, StandPlan, WalkPlan
from busemu.tables import load_robot
from hal.cpg.gait import Gait
from hal.cpg.network import tripods
from hal.legs import Legs

SCENE = SCENES["marvin-stand"]


@pytest.mark.parametrize("name", ["marvin", "phantomx"])
@pytest.mark.parametrize("programme", sorted(PLACES_M))
def test_feet_stay_and_the_trunk_goes(name, programme):
    robot = load_robot(name)
    gait, legs = Gait.of(robot), Legs.of(robot)
    postures = [angles for angles, _ in ways(StandPlan(programme), gait, legs)]
    feet = [legs.feet_m(angles) for angles in postures]
    for place, there in zip(PLACES_M[programme], feet[1:-1], strict=True):
        assert there - feet[0] == pytest.approx(-np.tile(place, (6, 1)))
    assert postures[-1] == pytest.approx(postures[0])


def test_a_middle_leg_of_those_that_stand_is_stretched():
    gait, legs = Gait.of(SCENE.robot), Legs.of(SCENE.robot)
    _, three, far, again, _ = (a for a, _ in ways(StandPlan("stretch"), gait, legs))
    moved = np.argwhere(far != three)
    assert len(moved) == 1
    leg, link = moved[0]
    standing, _ = tripods(legs)
    assert legs.names[leg] in standing
    assert abs(legs.hips_m[leg, 1]) == min(abs(legs.hips_m[:, 1]))
    assert far[leg, link] - three[leg, link] == pytest.approx(STRETCH_RAD)
    assert again == pytest.approx(three)


@pytest.mark.slow
def test_three_legs_carry_it_while_one_is_stretched_and_all_else():
    legs = Legs.of(SCENE.robot)
    carries = {}
    for programme in STANDING:
        plan = StandPlan(programme)
        whole = legged_sizing.believed(SCENE, plan)
        stands = play(SCENE, plan, whole.body, whole.electrics).stands
        middle = stands[len(stands) // 2]
        # servos are counted leg by leg
        carries[programme] = {n for n, up in zip(legs.names, middle[::3], strict=True) if up}
    every, three = set(legs.names), set(tripods(legs)[0])
    assert carries == {"squat": every, "sway": every, "stretch": three}


def test_an_unknown_programme_is_refused():
    gait, legs = Gait.of(SCENE.robot), Legs.of(SCENE.robot)
    with pytest.raises(ValueError, match="no standing programme 'jump': squat, sway, stretch"):
        list(ways(StandPlan("jump"), gait, legs))


@pytest.mark.slow
def test_what_is_on_the_trunk_stands_in_the_recording_and_has_no_phase_of_a_gait():
    draft = LeggedDraft(4, Asked(kind="null", rig=SCENE.name, style="position, voltage and load"))
    plan = StandPlan("sway", 0.092)
    measured = draft.measure(plan, "one", "one", 0.5)
    condition = measured.recording.metadata["condition"]
    assert (condition["payload_kg"], condition["programme"]) == (0.092, "sway")
    assert draft.case.truth(plan)[0].body.payload_kg == 0.092


@pytest.mark.slow
def test_an_effect_of_a_robot_that_stands_is_as_large_as_asked_and_has_no_share_in_stance():
    case = draw_legged(5, Asked("single", ("gain_error",), 4.0, "plain", SCENE.name))
    assert case.hidden[0].ratio == pytest.approx(4.0, rel=0.5)
    assert case.hidden[0].walking(SCENE) == pytest.approx(4.0, rel=0.5)
    assert stance_share(SCENE, case.hidden) is None


def test_a_leg_in_the_air_neither_stands_nor_walks():
    draft = LeggedDraft(4, Asked(kind="null", rig="marvin-leg"))
    for plan in (StandPlan("squat"), WalkPlan(1.0)):
        with pytest.raises(ValueError, match="is held in the air: it neither stands nor walks"):
            draft.measure(plan, "one", "one", 0.5)
