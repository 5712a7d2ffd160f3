"""Choosing candidates: rules before speed, the thesis's grid, the same from the same seed."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pretended_walks import MARVIN, ORIGINAL, outcome

from bench.experiments.locomotion_result import TORQUE_LIMIT
from bench.gaits.candidate import STRIDES, Candidate, GaitSearchError, Space
from bench.gaits.methods import evolution, grid_search, grid_values
from bench.gaits.outcome import Job, Reason, best
from hal.cpg import Gait

SPACE = Space(ORIGINAL)


def walked(candidates):
    return [outcome(Job(candidate, 5.0, 0)) for candidate in candidates]


def anything(_candidate):
    return True


def evolved(budget, seed=0, evaluate=walked, reachable=anything):
    return evolution(SPACE, evaluate, reachable, budget, seed)


def one(**changed):
    return outcome(Job(ORIGINAL, 5.0, 0), **changed)


# -- rules -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"torque_of_stall": TORQUE_LIMIT}, Reason.TORQUE),
        ({"self_collisions": 1}, Reason.SELF_COLLISION),
        ({"self_collision_share": 0.01}, Reason.SELF_COLLISION),
        ({"fell_after_s": 4.0}, Reason.FALL),
        ({"torque_of_stall": math.nan}, Reason.TORQUE),
    ],
)
def test_each_rule_forbids_a_walk_however_fast(changed, reason):
    fast, slow = one(speed_m_s=9.0, **changed), one(speed_m_s=0.0)
    assert fast.reasons == (reason,)
    assert slow.allowed
    assert slow.rank < fast.rank
    assert best([fast, slow]) is slow


def test_a_torque_just_below_the_limit_is_allowed():
    assert one(torque_of_stall=np.nextafter(TORQUE_LIMIT, 0.0)).allowed


def test_of_forbidden_walks_the_one_nearer_to_the_rules_is_better():
    assert one(torque_of_stall=0.8).rank < one(torque_of_stall=0.9).rank
    assert one(self_collision_share=0.1).rank < one(self_collision_share=0.2).rank
    assert one(fell_after_s=4.0).rank < one(fell_after_s=1.0).rank
    assert one(torque_of_stall=1.2).rank < one(fell_after_s=4.9).rank


def test_nothing_allowed_is_nothing_found():
    assert best([one(fell_after_s=1.0)]) is None


# -- CMA-ES ----------------------------------------------------------------------------------------


def test_the_evolution_ends_fast_and_within_the_rules():
    found = best(evolved(200))
    grid = best(grid_search(SPACE, walked, anything, 200))
    assert found.allowed
    assert found.speed_m_s > grid.speed_m_s > one().speed_m_s


def test_the_evolution_goes_to_the_edge_of_what_is_allowed():
    # what the made-up robot allows at its quickest period, with a duty factor of a half
    found = best(evolved(400))
    assert found.torque_of_stall > 0.9 * TORQUE_LIMIT
    assert found.job.candidate.duty_factor < ORIGINAL.duty_factor


def test_the_same_seed_asks_for_the_same_walks_and_another_for_others():
    first, again, other = ([o.job for o in evolved(20, seed)] for seed in (0, 0, 1))
    assert first == again
    assert first != other


def test_a_longer_budget_begins_with_the_walks_of_a_shorter_one():
    short, long = evolved(11), evolved(30)
    assert [o.job for o in short] == [o.job for o in long[:11]]


@pytest.mark.parametrize("budget", [1, 8, 13])
def test_the_evolution_walks_exactly_its_budget(budget):
    assert len(evolved(budget)) == budget


def test_the_optimiser_leaves_the_global_random_numbers_alone():
    np.random.seed(3)
    undisturbed = np.random.standard_normal()
    np.random.seed(3)
    evolved(10)
    assert np.random.standard_normal() == undisturbed


def test_candidates_out_of_reach_are_drawn_again_and_cost_no_walk():
    asked = []

    def evaluate(candidates):
        asked.extend(candidates)
        return walked(candidates)

    outcomes = evolved(30, evaluate=evaluate, reachable=lambda c: c.lift_m > ORIGINAL.lift_m)
    assert len(outcomes) == len(asked) == 30
    assert min(candidate.lift_m for candidate in asked) > ORIGINAL.lift_m


def test_a_robot_that_reaches_nothing_is_told_what_to_check():
    with pytest.raises(GaitSearchError, match=r"check \[gait\]"):
        evolved(10, reachable=lambda _: False)


def test_every_candidate_is_a_gait_the_robot_software_takes():
    for found in evolved(60):
        gait = Gait.of(found.job.candidate.on(MARVIN))  # raises where it does not
        assert gait.neutral_coxa_rad == Gait.of(MARVIN).neutral_coxa_rad
        assert gait.stride_m == Gait.of(MARVIN).stride_m


def test_the_middle_of_the_space_is_the_original_gait():
    middle = SPACE.candidate([0.0] * len(SPACE.axes))
    assert middle == ORIGINAL
    assert all(axis.low <= 0.0 <= axis.high for axis in SPACE.axes)


# -- grid ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("budget", "values"), [(1, 1), (35, 5), (36, 6), (100, 10), (999, 10)])
def test_the_grid_is_as_fine_as_the_budget_allows_and_ten_values_at_most(budget, values):
    assert grid_values(budget) == values
    assert len(grid_search(SPACE, walked, anything, budget)) == values**2 <= budget


def test_the_grid_changes_nothing_but_the_strides():
    jobs = [o.job.candidate for o in grid_search(SPACE, walked, anything, 100)]
    assert {(c.period_s, c.lift_m, c.duty_factor, c.femur_rad, c.tibia_rad) for c in jobs} == {
        (
            ORIGINAL.period_s,
            ORIGINAL.lift_m,
            ORIGINAL.duty_factor,
            ORIGINAL.femur_rad,
            ORIGINAL.tibia_rad,
        )
    }
    lefts = sorted({c.v_left for c in jobs})
    assert lefts == sorted({c.v_right for c in jobs})
    assert (lefts[0], lefts[-1]) == STRIDES
    assert np.ptp(np.diff(lefts)) == pytest.approx(0.0, abs=1e-12)


def test_cells_of_the_grid_out_of_reach_are_not_walked():
    found = grid_search(SPACE, walked, lambda c: c.stride < 4.0, 100)
    assert 0 < len(found) < 100
    assert all(o.job.candidate.stride < 4.0 for o in found)


# -- geometry --------------------------------------------------------------------------------------


def test_reach_is_a_matter_of_the_legs():
    assert ORIGINAL.reachable(MARVIN)
    rest = (ORIGINAL.period_s, ORIGINAL.lift_m, ORIGINAL.duty_factor, 0.5, -2.0)
    assert not Candidate(12.0, 12.0, *rest).reachable(MARVIN)


def test_a_point_is_where_its_candidate_is():
    x = np.array([0.3, -0.5, 1.0, -1.5, 0.7, -0.2, 2.0])
    assert SPACE.point(SPACE.candidate(x)) == pytest.approx(x)
    high = [axis.high for axis in SPACE.axes]
    assert SPACE.point(replace(ORIGINAL, period_s=9.0))[2] == high[2]


def test_a_search_goes_on_from_a_gait_that_is_known():
    begin = SPACE.candidate(np.array([0.3, -0.5, 1.0, -1.5, 0.7, -0.2, 2.0]))
    first, *others = evolution(SPACE, walked, anything, 8, 0, begin)
    assert SPACE.point(first.job.candidate) == pytest.approx(SPACE.point(begin))
    far = [np.linalg.norm(SPACE.point(one.job.candidate) - SPACE.point(begin)) for one in others]
    anew = [np.linalg.norm(SPACE.point(one.job.candidate)) for one in evolved(8)]
    assert 0.0 < np.median(far) < 0.7 * np.median(anew)
