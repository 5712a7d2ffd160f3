"""Which cases of whole robots a seed draws: of the generator's scenes of robots on their feet.

As in :mod:`bench.proof.plan`, the cases of each kind stand in an order of which every beginning is
balanced over scenes, effects, sizes and ways of concealment, as far as so few can be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import count
from typing import TypeVar

import numpy as np

from bench.blind import Asked, Concealment, Kind
from bench.blind.legged_effects import LEGGED
from bench.blind.scenes import SCENES

from .plan import Planned, case_seed

T = TypeVar("T")

#: scenes whose recordings a robot's diagnosis can use; of a leg on a stand only that leg is read
ON_FEET = tuple(name for name, scene in SCENES.items() if scene.support == "ground")
#: at the softest plausible floor joints move by 0.8 and 1.4 x the floor of the two robots: too
#: little to be asked for by name
UNSEEN = frozenset({"ground_compliance"})
HIDDEN = tuple(name for name in LEGGED if name not in UNSEEN)
SIZES = (1.0, 2.0, 4.0, 6.0)  #: the generator meets them within a fifth
SEEDS = 2  #: cases of each single effect of a size, in two scenes
LARGER = (2.0, 4.0, 6.0)  #: of what is judged as a set or as unknown
#: cases of each kind in a whole proof of robots; no stranger can be hidden in one
NUMBERS = {
    Kind.SINGLE: len(HIDDEN) * len(SIZES) * SEEDS,
    Kind.NULL: 40,
    Kind.PAIR: 20,
    Kind.DELETED: 10,
}
#: a quick proof hides and names only these, at the largest size
QUICK_EFFECTS = ("gain_error", "payload")
QUICK_NUMBERS = {Kind.SINGLE: 1, Kind.NULL: 1}


def robots(
    seed: int,
    cases: int,
    *,
    quick: bool = False,
    scenes: Sequence[str] = ON_FEET,
    only: Kind | None = None,
) -> tuple[Planned, ...]:
    """Cases of whole robots in the order they are diagnosed, shuffled; ``scenes`` by turns.

    ``only``: of one kind. Raises ``ValueError`` for a scene in which no robot is on its feet, and
    for a kind that robots have no cases of.
    """
    if unknown := sorted(set(scenes) - set(ON_FEET)):
        raise ValueError(f"no robot is on its feet in {', '.join(unknown)}: {', '.join(ON_FEET)}")
    if only is not None and only not in NUMBERS:
        known = ", ".join(kind.value for kind in NUMBERS)
        raise ValueError(f"whole robots have no case of {only.value}: use one of {known}")
    numbers = QUICK_NUMBERS if quick else NUMBERS if only is None else {only: NUMBERS[only]}
    drawn: list[tuple[int, Asked]] = []
    for kind, number in _dealt(cases, numbers).items():
        for index, asked in zip(range(number), _endless(seed, kind, quick, scenes), strict=False):
            drawn.append((case_seed(seed, f"robot {kind.value} {index}"), asked))
    order = np.random.default_rng([seed, 41]).permutation(len(drawn)).tolist()
    return tuple(
        Planned(f"robot-{n + 1:04d}", drawn[i][0], drawn[i][1], QUICK_EFFECTS if quick else ())
        for n, i in enumerate(order)
    )


def _dealt(cases: int, numbers: dict[Kind, int]) -> dict[Kind, int]:
    """So many cases, dealt to the kinds by largest remainders: few cases are of few kinds."""
    exact = {kind: cases * number / sum(numbers.values()) for kind, number in numbers.items()}
    dealt = {kind: int(share) for kind, share in exact.items()}
    by_rest = sorted(numbers, key=lambda kind: dealt[kind] - exact[kind])
    for kind in by_rest[: cases - sum(dealt.values())]:
        dealt[kind] += 1
    return dealt


def _endless(seed: int, kind: Kind, quick: bool, scenes: Sequence[str]) -> Iterator[Asked]:
    random = np.random.default_rng([seed, 40, *kind.value.encode()])
    scenes = _shuffled(random, scenes)
    names = _shuffled(random, QUICK_EFFECTS if quick else HIDDEN)
    sizes = _shuffled(random, SIZES if kind is Kind.SINGLE else LARGER)
    if quick:
        sizes = [SIZES[-1]]
    if kind is Kind.NULL:
        for number in count():
            yield Asked(kind.value, rig=scenes[number % len(scenes)])
    if kind is Kind.PAIR:
        for number in count():
            turn, at = divmod(number, len(scenes))
            hidden = (Concealment.PLAIN, Concealment.MASKED)[(turn // len(sizes)) % 2]
            yield Asked(kind.value, (), sizes[turn % len(sizes)], hidden.value, scenes[at])
    for number in count():
        turn, i = divmod(number, len(names))
        scene = scenes[(i + turn // len(sizes)) % len(scenes)]
        ratio = sizes[(i + turn) % len(sizes)]
        hidden = Concealment.PLAIN if quick else _concealment(names[i], i + turn)
        yield Asked(kind.value, (names[i],), ratio, hidden.value, scene)


def _shuffled(random: np.random.Generator, choices: Sequence[T]) -> list[T]:
    return [choices[i] for i in random.permutation(len(choices)).tolist()]


def _concealment(name: str, way: int) -> Concealment:
    """One of the ways that the effect can be concealed in, in turn; rare is in one leg alone."""
    rare = Concealment.RARE if LEGGED[name].scoped else Concealment.PLAIN
    return (Concealment.PLAIN, Concealment.MASKED, rare)[way % 3]
