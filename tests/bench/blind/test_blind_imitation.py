"""What of an effect no nuisance within its tolerance can imitate."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from short_programmes import short

from bench.blind import Asked, draw, imitation
from bench.blind.case import Case
from bench.blind.drafts import JointDraft
from bench.blind.imitation import Left, least, left_of
from bench.blind.nuisances import TOLERANCES, bounds, draw_nuisances
from bench.blind.sizing import noise_floor, observe, ratio_fitted, rms
from bench.blind.specimen import SIMPLEST

Floats = NDArray[np.float64]

GROUND = {"rig": "xl330-pendulum", "programme": "short slow", "style": "slow"}


def case_of(*effects: str, ratio: float, concealment: str = "plain", seed: int = 5) -> Case:
    kind = {1: "single", 2: "pair"}[len(effects)]
    return draw(seed, Asked(kind, effects, ratio, concealment, disguise=False, **GROUND))


def but(case: Case, **nuisances: float) -> Case:
    return dataclasses.replace(case, nuisances=dataclasses.replace(case.nuisances, **nuisances))


def whole(case: Case) -> float:
    """All that the first effect changes, as the case truly is, in noise floors."""
    one = case.hidden[0]
    return ratio_fitted(case.ground, one.name, one.size, one.how, case.nuisances)


def seen(case: Case) -> Floats:
    where = case.ground
    return np.concatenate(
        [
            observe(where.style, run, case.specimen(run.plan))
            for run in where.programme.runs
            if run.group not in where.programme.held_out
        ]
    )


@pytest.fixture(scope="module", autouse=True)
def short_programme() -> Iterator[None]:
    with short("slow", without=("dither-stiff", "hold-heavy")):
        yield


@pytest.fixture(scope="module")
def weight_aside() -> Case:
    return case_of("com_offset", ratio=3.0)


@pytest.fixture(scope="module")
def left_of_weight(weight_aside: Case) -> Left:
    return left_of(weight_aside, 0)


def test_every_tolerance_is_drawn_to_its_ends_and_no_further() -> None:
    drawn = [draw_nuisances(np.random.default_rng(n), 5.0).document() for n in range(300)]
    ends = bounds(5.0)
    assert set(ends) == {*TOLERANCES, "droop_v_s"}
    for name, (low, high) in ends.items():
        values = [float(one[name]) for one in drawn]
        assert low <= min(values) < low + 0.05 * (high - low), name
        assert high >= max(values) > high - 0.05 * (high - low), name


ALONG = np.linspace(0.0, 1.0, 200)
ENDS = -np.ones(2), np.ones(2)


def kinked(x: Floats) -> Floats:
    """A trace that does not change with its first number until that is large."""
    first = np.maximum(x[0] - 0.7, 0.0) * np.sin(9.0 * ALONG)
    return 40.0 * (first + (x[1] - 0.8 * x[0] + 0.3 * x[0] ** 2) * np.cos(5.0 * ALONG))


def bent(x: Floats) -> Floats:
    second = x[1] + 0.5 * x[0] * x[1] ** 2
    return 10.0 * (np.sin(1.5 * x[0]) * np.sin(9.0 * ALONG) + second * np.cos(5.0 * ALONG))


def test_what_bends_is_followed_to_its_least_rest() -> None:
    true = bent(np.array([0.5, -0.9]))
    at, rest = least(lambda x: true - bent(x), *ENDS, 1.0)
    assert rms(true) > 4.0
    assert rms(rest) < 0.02
    assert at == pytest.approx([0.5, -0.9], abs=0.01)


def test_tangents_that_misled_are_taken_anew() -> None:
    true = kinked(np.array([0.5, -0.9]))
    _, rest = least(lambda x: true - kinked(x), *ENDS, 1.0)
    assert rms(rest) < 0.02  # with those across the kink alone, 0.25


def test_no_rest_is_sought_beyond_a_bound() -> None:
    true = bent(np.array([0.2, 1.5]))
    at, rest = least(lambda x: true - bent(x), *ENDS, 1.0)
    assert at[1] == 1.0
    assert rms(rest) > 2.0


def test_what_tolerances_imitate_is_not_left(weight_aside: Case, left_of_weight: Left) -> None:
    assert whole(weight_aside) > 3.0
    # a tilt, a zero and 3 mm turn gravity as well
    assert left_of_weight.ratio < min(1.0, 0.2 * whole(weight_aside))


@pytest.mark.slow
def test_play_is_left_for_no_tolerance_has_it() -> None:
    case = case_of("backlash", ratio=5.0)
    left = left_of(case, 0).ratio
    assert 0.6 * whole(case) < left <= whole(case)


@pytest.mark.slow
def test_without_tolerances_the_whole_effect_is_left(
    weight_aside: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    def known(_: float) -> dict[str, tuple[float, float]]:
        now = weight_aside.nuisances
        return {name: (getattr(now, name) - 1e-9, getattr(now, name) + 1e-9) for name in TOLERANCES}

    monkeypatch.setattr(imitation, "bounds", known)
    assert left_of(weight_aside, 0).ratio == pytest.approx(whole(weight_aside), rel=0.01)


def test_what_is_told_was_rolled_out_within_the_bounds(
    weight_aside: Case, left_of_weight: Left
) -> None:
    left = left_of_weight
    for name, (low, high) in bounds(5.0).items():
        assert low <= left.imitation[name] <= high, name
    without = dataclasses.replace(but(weight_aside, **left.imitation), hidden=())
    floor = noise_floor(weight_aside.ground.key)
    assert rms(seen(weight_aside) - seen(without)) / floor == pytest.approx(left.ratio, rel=1e-6)


@pytest.mark.slow
def test_a_nuisance_that_is_at_its_bound_already_cannot_imitate_more() -> None:
    case = case_of("coulomb_friction", ratio=2.0)
    spent, free = (left_of(but(case, coulomb_factor=f), 0).ratio for f in (1.3, 0.7))
    assert spent > 2.0 * free


@pytest.mark.slow
def test_the_size_of_another_part_is_not_known_either() -> None:
    case = case_of("link_mass", ratio=3.0, concealment="masked")
    (mask,) = case.ordinary
    told = left_of(case, 0).imitation
    assert set(told) == {*bounds(5.0), f"{mask.name}.size"}
    assert 0.0 < told[f"{mask.name}.size"] <= 2.0 * mask.size
    assert told[f"{mask.name}.size"] != mask.size


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.slow
def test_each_of_a_pair_is_held_beside_the_other(index: int) -> None:
    case = case_of("backlash", "com_offset", ratio=3.0, seed=7)
    assert case.ground.build == SIMPLEST  # play before a spring rattles: descents end early there
    left = left_of(case, index)
    assert {name for name in left.imitation if name.endswith(".size")} == {
        f"{case.hidden[1 - index].name}.size"
    }
    assert (left.ratio > 1.0) == (index == 0)  # play is left, a weight aside is not


@pytest.mark.slow
def test_measuring_what_is_left_changes_no_recording() -> None:
    asked = Asked("single", ("com_offset",), 3.0, "plain", disguise=False, **GROUND)
    made, told = JointDraft(5, asked), JointDraft(5, asked)
    (effect,) = told.told()["effects"]

    def recorded(one: JointDraft) -> str:
        group, plan = one.plans[0]
        found = one.measure(plan, "one", group, 0.5).recording
        return hashlib.sha256(found.table.column("raw").to_numpy().tobytes()).hexdigest()

    assert recorded(made) == recorded(told)
    assert made.case == told.case
    assert set(effect["left"]) == {"ratio", "imitation"}
    assert effect["ratio"] == made.case.hidden[0].ratio  # sizes are what they were drawn to be
