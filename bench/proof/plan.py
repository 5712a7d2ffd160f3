"""Which cases a seed draws: the contract's numbers, or a balanced part of them.

The cases of each kind stand in an order of which every beginning is balanced over effects, sizes
and ways of concealment; a smaller proof takes the beginnings.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from bench.blind import Asked, Concealment, Kind
from bench.blind.effects import EFFECTS
from bench.blind.rigs import BRIEF
from bench.blind.scenes import SCENES
from bench.blind.sizing import RATIOS
from bench.blind.unlisted import STRANGERS

REPEATS = 5  #: seeds of every effect at every size
#: sizes of what is judged as a set or as unknown: below, nothing is there to be seen
LARGER = (2.0, 3.0, 5.0, 8.0)
#: cases of each kind in the whole proof
NUMBERS = {
    Kind.SINGLE: len(EFFECTS) * len(RATIOS) * REPEATS,
    Kind.NULL: 300,
    Kind.PAIR: 100,
    Kind.TRIPLE: 40,
    Kind.DELETED: 100,
    Kind.STRANGER: 3 * len(LARGER) * len(STRANGERS),
}
ABRUPT = "overload_shutdown"
#: a concealment below the quantisation step is asked for at sizes up to this
SUB_QUANTUM_MOST = 2.0
#: a quick proof: so few effects that a diagnosis takes seconds
QUICK_EFFECTS = ("coulomb_friction", "link_mass", "transport_delay", "viscous_friction")


@dataclass(frozen=True, slots=True)
class Planned:
    """A case to write: its folder's name, which tells nothing, its seed and what is fixed."""

    name: str
    seed: int
    asked: Asked
    catalogue: tuple[str, ...] = ()  #: effects that the diagnosis may name; none: all

    @property
    def robot(self) -> bool:
        """Whether it is of a whole robot."""
        return self.asked.rig in SCENES

    def document(self) -> dict[str, Any]:
        """As plain values; :meth:`of` reads it."""
        return {
            "name": self.name,
            "seed": self.seed,
            "asked": self.asked.document(),
            "catalogue": list(self.catalogue),
        }

    @classmethod
    def of(cls, document: dict[str, Any]) -> Planned:
        """From plain values."""
        asked = Asked.of(document["asked"])
        return cls(document["name"], document["seed"], asked, tuple(document["catalogue"]))


def case_seed(seed: int, what: str, attempt: int = 0) -> int:
    """A case's own seed: from the proof's seed and what the case is, nothing else."""
    digest = hashlib.sha256(f"busemu-proof/1 {seed} {what} {attempt}".encode()).digest()
    return int.from_bytes(digest[:7], "big")


def plan(
    seed: int,
    cases: int | None = None,
    *,
    quick: bool = False,
    only: Kind | None = None,
    way: Concealment | None = None,
) -> tuple[Planned, ...]:
    """The cases of a proof in the order they are diagnosed, shuffled.

    ``cases``: a balanced part of so many, or none; ``only``: of one kind; ``way``: with ``only``,
    those alone that are concealed in one way. Raises ``ValueError`` if ``cases`` is less than the
    number of kinds, or where no case of the kind is concealed that way.
    """
    if cases == 0:
        return ()
    if quick:
        return _named(seed, list(_quick(seed)), QUICK_EFFECTS)
    if only is not None:
        numbers = {only: min(cases or NUMBERS[only], NUMBERS[only])}
    else:
        numbers = dict(NUMBERS) if cases is None else shares(cases)
    drawn: list[tuple[int, Asked]] = []
    for kind, count in numbers.items():
        for index, asked in islice(_of_way(seed, kind, way), count):
            drawn.append((case_seed(seed, f"{kind.value} {index}"), asked))
    return _named(seed, drawn, ())


def _of_way(seed: int, kind: Kind, way: Concealment | None) -> Iterator[tuple[int, Asked]]:
    """Cases of a kind with their numbers; of one way of concealment, if that is given."""
    none_yet = True
    for index, asked in enumerate(_endless(seed, kind)):
        if way is None or asked.concealment == way.value:
            none_yet = False
            yield index, asked
        elif none_yet and index == NUMBERS[kind]:
            raise ValueError(f"no {kind.value} case is concealed that way: {way.value}")


def shares(cases: int) -> dict[Kind, int]:
    """So many cases, dealt to the kinds as in the whole proof, each at least one."""
    if cases < len(NUMBERS):
        raise ValueError(f"a proof needs at least {len(NUMBERS)} cases, one of each kind")
    cases = min(cases, sum(NUMBERS.values()))
    exact = {kind: cases * number / sum(NUMBERS.values()) for kind, number in NUMBERS.items()}
    dealt = {kind: max(1, int(share)) for kind, share in exact.items()}
    while (left := cases - sum(dealt.values())) != 0:
        way = 1 if left > 0 else -1
        able = [kind for kind in dealt if way > 0 or dealt[kind] > 1]
        kind = max(able, key=lambda k: way * (exact[k] - dealt[k]))
        dealt[kind] += way
    return dealt


def _named(
    seed: int, drawn: list[tuple[int, Asked]], catalogue: tuple[str, ...]
) -> tuple[Planned, ...]:
    order = np.random.default_rng([seed, 31]).permutation(len(drawn))
    return tuple(
        Planned(f"case-{number + 1:04d}", drawn[index][0], drawn[index][1], catalogue)
        for number, index in enumerate(order.tolist())
    )


def _endless(seed: int, kind: Kind) -> Iterator[Asked]:
    random = np.random.default_rng([seed, 30, *kind.value.encode()])
    if kind is Kind.NULL:
        while True:
            yield Asked(kind.value)
    if kind in (Kind.PAIR, Kind.TRIPLE):
        yield from _sets(kind)
    names = list(STRANGERS if kind is Kind.STRANGER else EFFECTS)
    names = [names[i] for i in random.permutation(len(names)).tolist()]
    sizes = RATIOS if kind is Kind.SINGLE else LARGER
    turn = 0
    while True:
        for i, name in enumerate(names):
            ratio = sizes[(i + turn) % len(sizes)]
            way = i + turn + turn // len(sizes)
            hidden = _concealment(kind, name, ratio, way).value
            yield Asked(kind.value, (name,), ratio, hidden)
        turn += 1


def _sets(kind: Kind) -> Iterator[Asked]:
    turn = 0
    while True:
        hidden = (Concealment.PLAIN, Concealment.MASKED)[(turn // len(LARGER)) % 2]
        yield Asked(kind.value, (), LARGER[turn % len(LARGER)], hidden.value)
        turn += 1


def _concealment(kind: Kind, name: str, ratio: float, way: int) -> Concealment:
    """One of the ways that the effect can be concealed in, in turn."""
    if name == ABRUPT:
        return Concealment.PLAIN
    if kind is not Kind.SINGLE:
        return (Concealment.PLAIN, Concealment.MASKED)[way % 2]
    effect = EFFECTS[name]
    plain = Concealment.PLAIN
    return (
        plain,
        Concealment.MASKED,
        Concealment.RARE if effect.gates else plain,
        Concealment.MIMICKED if effect.rivals else Concealment.MASKED,
        Concealment.SUB_QUANTUM if ratio <= SUB_QUANTUM_MOST else plain,
    )[way % 5]


def _quick(seed: int) -> Iterator[tuple[int, Asked]]:
    """Cases that are diagnosed in seconds: large effects, brief motions, few registers."""
    plain = Concealment.PLAIN.value
    for kind, effects, ratio in (
        (Kind.NULL, (), None),
        (Kind.SINGLE, ("transport_delay",), 8.0),
    ):
        asked = Asked(
            kind.value,
            effects,
            ratio,
            plain,
            "xl330-pendulum",
            "slow",
            BRIEF,
            disguise=False,
        )
        yield case_seed(seed, f"quick {kind.value}"), asked


def attempts(planned: Planned) -> Iterator[tuple[int, Asked]]:
    """What is tried, in this order, until a case can be had: other draws, then concealed plainly.

    Not every effect reaches every size on every rig; a robot's scene is what it is.
    """
    asked = planned.asked
    yield planned.seed, asked
    yield case_seed(planned.seed, "again"), asked
    if asked.concealment != Concealment.PLAIN.value:
        yield case_seed(planned.seed, "plain"), replace(asked, concealment=Concealment.PLAIN.value)
    if not planned.robot:
        yield case_seed(planned.seed, "open"), replace(asked, concealment=None)


def fingerprint(cases: tuple[Planned, ...]) -> str:
    """A hash of a plan."""
    text = json.dumps([case.document() for case in cases], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
