"""The plan: the contract's numbers, balanced, and the same for the same seed."""

from collections import Counter

import pytest

from bench.blind import Concealment, Kind
from bench.blind.effects import EFFECTS
from bench.blind.sizing import RATIOS
from bench.blind.unlisted import STRANGERS
from bench.proof.plan import NUMBERS, REPEATS, fingerprint, plan, shares


def kinds(cases):
    return Counter(Kind(case.asked.kind) for case in cases)


def singles(cases):
    return [case.asked for case in cases if case.asked.kind == "single"]


def test_the_whole_plan_has_at_least_the_numbers_of_the_contract():
    found = kinds(plan(3))
    assert found == NUMBERS
    assert found[Kind.NULL] >= 300
    assert found[Kind.PAIR] >= 100
    assert found[Kind.TRIPLE] >= 40
    assert found[Kind.DELETED] >= 100
    grid = Counter((asked.effects, asked.ratio) for asked in singles(plan(3)))
    assert len({effects for effects, _ in grid}) == len(EFFECTS) >= 12
    assert {ratio for _, ratio in grid} == set(RATIOS)
    assert set(grid.values()) == {REPEATS}


def test_an_effect_at_a_size_is_concealed_in_different_ways():
    ways = [a.concealment for a in singles(plan(3)) if a.effects == ("backlash",) and a.ratio == 1]
    assert sorted(ways) == ["masked", "mimicked", "plain", "rare", "sub_quantum"]


@pytest.mark.parametrize("count", [60, 200])
def test_a_part_is_balanced_over_kinds_effects_and_sizes(count):
    part = plan(5, count)
    whole = sum(NUMBERS.values())
    assert len(part) == count
    for kind, number in kinds(part).items():
        assert abs(number - count * NUMBERS[kind] / whole) < 1.0
    by_effect = Counter(a.effects for a in singles(part))
    assert max(by_effect.values()) - min(by_effect.values() if count > 60 else [1]) <= 1
    by_ratio = Counter(a.ratio for a in singles(part))
    assert max(by_ratio.values()) - min(by_ratio.values()) <= len(RATIOS) // 2


def test_every_kind_has_a_case_in_the_smallest_part():
    assert set(kinds(plan(5, len(NUMBERS)))) == set(NUMBERS)
    assert sum(shares(len(NUMBERS) + 1).values()) == len(NUMBERS) + 1
    with pytest.raises(ValueError, match=f"at least {len(NUMBERS)} cases"):
        plan(5, len(NUMBERS) - 1)


def test_cases_of_one_kind_are_those_of_the_whole():
    nulls = [case for case in plan(5) if case.asked.kind == "null"]
    some = plan(5, 20, only=Kind.NULL)
    assert len(some) == 20
    assert {case.seed for case in some} <= {case.seed for case in nulls}
    assert len(plan(5, only=Kind.NULL)) == len(plan(5, 10_000, only=Kind.NULL)) == len(nulls)


def test_the_seed_alone_makes_the_plan():
    assert plan(5, 40) == plan(5, 40)
    assert fingerprint(plan(5, 40)) == fingerprint(plan(5, 40))
    assert fingerprint(plan(5, 40)) != fingerprint(plan(6, 40))
    assert not {c.seed for c in plan(5)} & {c.seed for c in plan(6)}


def test_no_two_cases_share_a_seed_or_a_name():
    cases = plan(5)
    assert len({c.seed for c in cases}) == len({c.name for c in cases}) == len(cases)


def test_a_part_is_of_the_cases_of_the_whole():
    assert {c.seed for c in plan(5, 80)} <= {c.seed for c in plan(5)}


def test_names_say_nothing_of_the_kind():
    cases = plan(5)
    assert [c.name for c in cases] == [f"case-{n + 1:04d}" for n in range(len(cases))]
    first = kinds(cases[:200])
    assert len(first) == len(NUMBERS)  # shuffled: any beginning is a sample of all kinds


def test_strangers_are_all_asked_for():
    named = Counter(c.asked.effects for c in plan(5) if c.asked.kind == "stranger")
    assert {name for (name,) in named} == set(STRANGERS)
    assert len(set(named.values())) == 1


def test_cases_of_one_way_of_concealment_are_those_that_are_drawn_anyway():
    every = {(case.seed, case.asked) for case in plan(3, only=Kind.SINGLE)}
    rare = plan(3, 7, only=Kind.SINGLE, way=Concealment.RARE)
    assert len(rare) == 7
    assert {case.asked.concealment for case in rare} == {"rare"}
    assert {(case.seed, case.asked) for case in rare} < every


def test_a_kind_that_is_never_concealed_in_a_way_is_refused():
    with pytest.raises(ValueError, match="no pair case is concealed that way: rare"):
        plan(3, 7, only=Kind.PAIR, way=Concealment.RARE)
