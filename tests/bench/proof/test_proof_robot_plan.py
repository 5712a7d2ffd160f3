"""The plan of robots' cases: kinds, scenes and sizes in balance, and the same for the same seed."""

from collections import Counter

import pytest

from bench.blind import Kind
from bench.blind.legged_effects import LEGGED
from bench.proof.plan import Planned, attempts, plan
from bench.proof.robot_plan import (
    HIDDEN,
    NUMBERS,
    ON_FEET,
    QUICK_EFFECTS,
    SIZES,
    robots,
)

WHOLE = sum(NUMBERS.values())


def kinds(cases):
    return Counter(Kind(case.asked.kind) for case in cases)


def test_the_whole_plan_has_at_least_the_numbers_of_the_contract():
    found = kinds(robots(3, WHOLE))
    assert found == NUMBERS
    assert found[Kind.NULL] >= 40
    assert found[Kind.PAIR] >= 20
    assert found[Kind.DELETED] >= 10
    singles = [c.asked for c in robots(3, WHOLE) if c.asked.kind == "single"]
    grid = Counter((a.effects, a.ratio) for a in singles)
    assert len({effects for effects, _ in grid}) == len(HIDDEN) >= 8
    assert {ratio for _, ratio in grid} == set(SIZES)
    assert len(SIZES) >= 4
    assert set(grid.values()) == {2}  # two seeds of each, in two scenes
    assert set(Counter(a.rig for a in singles).values()) == {len(singles) // len(ON_FEET)}
    assert len({(a.effects, a.ratio, a.rig) for a in singles}) == len(singles)


def test_few_cases_are_of_the_commonest_kinds_and_of_all_scenes():
    assert kinds(robots(3, 2)) == {Kind.SINGLE: 1, Kind.NULL: 1}
    assert len(robots(3, 7)) == 7
    twenty = robots(3, 20)
    assert set(kinds(twenty)) == set(NUMBERS)
    on = Counter(case.asked.rig for case in twenty)
    assert set(on) == set(ON_FEET)
    assert max(on.values()) - min(on.values()) <= 4
    assert robots(3, 0) == ()


def test_a_scene_on_a_stand_is_left_out_as_only_one_leg_is_read_there():
    assert "marvin-leg" not in ON_FEET
    assert set(ON_FEET) == {"marvin-walk", "phantomx-walk", "marvin-stand", "phantomx-stand"}


def test_scenes_that_are_asked_for_are_the_only_ones():
    assert {c.asked.rig for c in robots(3, 20, scenes=["phantomx-stand"])} == {"phantomx-stand"}
    with pytest.raises(ValueError, match="no robot is on its feet in marvin-leg: marvin-walk"):
        robots(3, 20, scenes=["marvin-leg", "marvin-walk"])


def test_cases_of_one_kind_are_those_of_the_whole():
    pairs = robots(3, 6, only=Kind.PAIR)
    assert kinds(pairs) == {Kind.PAIR: 6}
    assert {c.seed for c in pairs} < {c.seed for c in robots(3, WHOLE)}
    with pytest.raises(ValueError, match="no case of triple: use one of single, null, pair"):
        robots(3, 6, only=Kind.TRIPLE)


def test_the_seed_alone_makes_the_plan():
    assert robots(5, 30) == robots(5, 30)
    assert not {c.seed for c in robots(5, 30)} & {c.seed for c in robots(6, 30)}
    assert {c.seed for c in robots(5, 30)} <= {c.seed for c in robots(5, WHOLE)}


def test_names_and_seeds_are_others_than_those_of_the_joints():
    cases = (*plan(5), *robots(5, WHOLE))
    assert len({c.name for c in cases}) == len({c.seed for c in cases}) == len(cases)
    assert [c.name for c in cases if c.robot] == [f"robot-{n + 1:04d}" for n in range(WHOLE)]


def test_only_what_can_be_in_one_leg_is_rare():
    cases = robots(5, WHOLE)
    rare = [c.asked.effects[0] for c in cases if c.asked.concealment == "rare"]
    assert rare
    assert all(LEGGED[name].scoped for name in rare)


def test_a_scene_stays_what_it_is_when_a_case_is_tried_again():
    case = next(c for c in robots(5, 20) if c.asked.concealment == "masked")
    tried = list(attempts(case))
    assert {asked.rig for _, asked in tried} == {case.asked.rig}
    assert [asked.concealment for _, asked in tried] == ["masked", "masked", "plain"]
    assert len({seed for seed, _ in tried}) == len(tried)


def test_a_plan_survives_its_document():
    for case in robots(5, 10, quick=True):
        assert Planned.of(case.document()) == case


@pytest.mark.parametrize("seed", range(5))
def test_a_quick_robot_hides_what_its_small_catalogue_can_name(seed):
    for case in robots(seed, 4, quick=True):
        assert case.catalogue == QUICK_EFFECTS
        assert set(case.asked.effects) <= set(QUICK_EFFECTS)
        assert case.asked.kind in ("single", "null")
    assert all(case.catalogue == () for case in robots(seed, 4))
