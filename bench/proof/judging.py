"""Whether a diagnosis is right, case by case. The rules stand in docs/proof/rules.md."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bench.blind import Concealment
from bench.blind.legged_case import LOAD, READS
from bench.blind.rigs import RIGS
from bench.blind.scenes import SCENES

from .equivalence import Sight, same
from .places import Place, place_of
from .truths import error_of, true_parameters

STATED_MOST = 3  #: names that a stated class may have; with more it is no answer
POSITION_STYLE = "position"  #: the sampling style that reads nothing else
WALK = "walk"  #: the programme of every robot
UNKNOWN = ("unexplained", "partly_explained")  #: verdicts that say that something has no name
CERTAIN = 0.9
UNKNOWN_KINDS = ("deleted", "stranger")  #: their effect is in no catalogue
RIGHT, ALSO_TRUE, WRONG = "hidden", "ordinary", "wrong"


@dataclass(frozen=True, slots=True)
class Named:
    """A cause that a diagnosis names, and what became of it when the key was opened."""

    effect: str
    probability: float
    class_probability: float  #: with that of listed rivals which are one with it
    label: str  #: ``hidden``, ``ordinary`` (true, but not what was concealed) or ``wrong``
    exact: bool  #: true by its very name
    parameters: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Checked:
    """A parameter of a rightly named effect against the truth."""

    effect: str
    name: str
    main: bool  #: says how large the effect is; others only shape it
    true: float
    value: float
    error: float  #: a share; nan where it is not main
    covered: bool | None  #: whether the interval holds the truth; no interval: ``None``


@dataclass(frozen=True, slots=True)
class Judged:
    """A case with its truth, its diagnosis and what is right about it."""

    case: str
    kind: str
    concealment: str
    rig: str
    programme: str
    style: str
    hidden: tuple[str, ...]
    ordinary: tuple[str, ...]
    ratio: float  #: of the smallest concealed effect to the detection floor; nan: none is
    left: float  #: the same of what tolerances cannot imitate; nan: not measured, too
    failure: str
    verdict: str
    named: tuple[Named, ...]
    first_exact: bool  #: the first name is the concealed effect's
    first_right: bool  #: or that of one which is the same, or of the class it states
    second_right: bool  #: right at the first or the second guess
    set_exact: bool  #: all that is concealed, and nothing else that is not true, by name
    set_right: bool  #: the same by class
    checked: tuple[Checked, ...]
    explained: float | None  #: share of the explainable held-out misfit that is removed
    mse_before: float
    mse_after: float
    mse_oracle: float
    ambiguous: bool  #: the first cause has rivals that are not told apart
    seconds: float
    walking: float = math.nan  #: the ratio while a robot walks, without standing up; nan: no robot
    place: Place | None = None  #: in a robot: where something is hidden, and where it was found

    @property
    def robot(self) -> bool:
        """Whether it is of a whole robot."""
        return self.rig in SCENES

    @property
    def wrong(self) -> tuple[Named, ...]:
        """Causes that are not true."""
        return tuple(n for n in self.named if n.label == WRONG)

    @property
    def says_unknown(self) -> bool:
        """Says that something is left, and names nothing that is not true."""
        return self.verdict in UNKNOWN and not self.wrong

    @property
    def alarms(self) -> bool:
        """Says anything but that all is as believed."""
        return self.verdict != "consistent"

    @property
    def certain_and_wrong(self) -> bool:
        """Says that a wrong cause explains it, and is sure."""
        return self.verdict == "explained" and any(n.probability > CERTAIN for n in self.wrong)


def judge(
    case: str, key: Mapping[str, Any], diagnosis: Mapping[str, Any] | None, told: Mapping[str, Any]
) -> Judged:
    """Judge a diagnosis against its key; ``told`` is how it was made (``seconds``, ``failure``)."""
    sight = _sight(key)
    hidden = tuple(effect["effect"] for effect in key["effects"])
    ordinary = tuple(effect["effect"] for effect in key["ordinary"])
    findable = () if key["kind"] in UNKNOWN_KINDS else hidden
    causes: Sequence[Mapping[str, Any]] = diagnosis["causes"] if diagnosis else ()
    if key["rig"] in SCENES:
        causes = merged(causes)
    named = _labelled(causes, findable, ordinary, sight)
    ratios = [float(effect["ratio"]) for effect in key["effects"]]
    left = [float(effect["left"]["ratio"]) for effect in key["effects"] if effect.get("left")]
    told_walking = (effect.get("walking_ratio") for effect in key["effects"])
    walking = [float(ratio) for ratio in told_walking if ratio is not None]
    first, second = _guesses(causes, named)
    classes = [same(name, sight) for name in findable]
    stated = _stated(causes, named)
    clean = all(n.label != WRONG for n in named)
    exact = sorted(n.effect for n in named if n.label == RIGHT and n.exact) == sorted(findable)
    complete = sum(n.label == RIGHT for n in named) == len(findable)
    before, after, oracle = _squares(key, diagnosis)
    return Judged(
        case=case,
        kind=key["kind"],
        concealment=key["concealment"],
        rig=key["rig"],
        programme=key.get("programme", WALK),
        style=key.get("style", POSITION_STYLE),
        hidden=hidden,
        ordinary=ordinary,
        ratio=min(ratios, default=math.nan),
        left=min(left, default=math.nan),
        walking=min(walking, default=math.nan),
        failure=told["failure"],
        verdict=diagnosis["verdict"] if diagnosis else "failed",
        named=named,
        first_exact=first in findable,
        first_right=any(first in c for c in classes) or _states(stated, classes),
        second_right=any(first in c or second in c for c in classes) or _states(stated, classes),
        set_exact=clean and exact,
        set_right=clean and complete,
        checked=_checked(key, named),
        explained=_explained(before, after, oracle, float(key["noise_floor_rad"])),
        mse_before=before,
        mse_after=after,
        mse_oracle=oracle,
        ambiguous=bool(causes and causes[0]["indistinguishable_from"]),
        seconds=float(told["seconds"]),
        place=_place(key, diagnosis, causes, named) if key["rig"] in SCENES else None,
    )


def _sight(key: Mapping[str, Any]) -> Sight:
    """What the data can show."""
    if key["rig"] in SCENES:
        style = key.get("style", POSITION_STYLE)
        every = key["concealment"] != Concealment.RARE.value
        no_duty = LOAD not in READS.get(style, ())
        only = style == POSITION_STYLE
        return Sight(only, upright=False, all_feet=every, no_duty=no_duty, legs=True)
    return Sight(key["style"] == POSITION_STYLE, RIGS[key["rig"]].upright)


def merged(causes: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Causes of one name at several places of a robot as one, in the first one's words."""
    found: dict[str, Mapping[str, Any]] = {}
    for cause in causes:
        first = found.setdefault(cause["effect"], cause)
        if first is not cause:
            found[cause["effect"]] = {
                **first,
                "scope": [*first["scope"], *cause["scope"]] if first["scope"] else [],
                "parameters": {**cause["parameters"], **first["parameters"]},
            }
    return list(found.values())


def _place(
    key: Mapping[str, Any],
    diagnosis: Mapping[str, Any] | None,
    causes: Sequence[Mapping[str, Any]],
    named: Sequence[Named],
) -> Place | None:
    told = zip(causes, named, strict=True)
    own = [cause for cause, one in told if one.label != ALSO_TRUE]
    return place_of(key, own, diagnosis["mismatch"] if diagnosis else ())


def _labelled(
    causes: Sequence[Mapping[str, Any]],
    hidden: Sequence[str],
    ordinary: Sequence[str],
    sight: Sight,
) -> tuple[Named, ...]:
    """Every true effect answers for one cause: of its very name, or else of its class."""
    left = [(name, RIGHT) for name in hidden] + [(name, ALSO_TRUE) for name in ordinary]
    labels = [WRONG] * len(causes)
    exact = [False] * len(causes)
    for by_name in (True, False):
        for i, cause in enumerate(causes):
            if labels[i] != WRONG:
                continue
            for truth in left:
                alike = {truth[0]} if by_name else same(truth[0], sight)
                if cause["effect"] in alike:
                    labels[i], exact[i] = truth[1], by_name
                    left.remove(truth)
                    break
    found = []
    for cause, label, by_name in zip(causes, labels, exact, strict=True):
        own = same(cause["effect"], sight)
        rivals = cause["indistinguishable_from"]
        shared = sum(float(r["probability"]) for r in rivals if r["effect"] in own)
        stated = float(cause["probability"])
        found.append(
            Named(
                effect=cause["effect"],
                probability=stated,
                class_probability=min(1.0, stated + shared),
                label=label,
                exact=by_name,
                parameters=cause["parameters"],
            )
        )
    return tuple(found)


def _guesses(
    causes: Sequence[Mapping[str, Any]], named: Sequence[Named]
) -> tuple[str | None, str | None]:
    """The first cause that is no ordinary truth, and its nearest rival, or else the next cause."""
    own = [i for i, n in enumerate(named) if n.label != ALSO_TRUE]
    if not own:
        return None, None
    first = causes[own[0]]
    rivals = first["indistinguishable_from"]
    if rivals:
        return first["effect"], max(rivals, key=lambda r: float(r["probability"]))["effect"]
    return first["effect"], causes[own[1]]["effect"] if len(own) > 1 else None


def _stated(causes: Sequence[Mapping[str, Any]], named: Sequence[Named]) -> frozenset[str]:
    """The class that the first cause states, if it is small enough to be one."""
    for cause, own in zip(causes, named, strict=True):
        if own.label != ALSO_TRUE:
            names = {cause["effect"], *(r["effect"] for r in cause["indistinguishable_from"])}
            return frozenset(names) if len(names) <= STATED_MOST else frozenset()
    return frozenset()


def _states(stated: frozenset[str], classes: Sequence[frozenset[str]]) -> bool:
    return any(stated & c for c in classes)


def _checked(key: Mapping[str, Any], named: Sequence[Named]) -> tuple[Checked, ...]:
    found = []
    for effect in (*key["effects"], *key["ordinary"]):
        own = [n for n in named if n.exact and n.effect == effect["effect"]]
        if not own:
            continue
        for index, (name, true) in enumerate(true_parameters(effect, key["rig"]).items()):
            estimate = own[0].parameters.get(name)
            if estimate is None or estimate["value"] is None:
                continue
            low, high = estimate["ci95"]
            covered = None
            if low is not None and high is not None:
                covered = bool(low <= true.value <= high)
            value = float(estimate["value"])
            error = error_of(true, value) if index == 0 else math.nan
            found.append(
                Checked(own[0].effect, name, index == 0, true.value, value, error, covered)
            )
    return tuple(found)


def _squares(
    key: Mapping[str, Any], diagnosis: Mapping[str, Any] | None
) -> tuple[float, float, float]:
    """Mean squares [rad^2] on what judged: before, after, and of the truth itself."""
    if diagnosis is None or not diagnosis["fit"]["held_out"]:
        return math.nan, math.nan, math.nan
    told = diagnosis["fit"]
    oracle = [float(key["oracle"][name]["mse_rad2"]) for name in told["recordings"]]
    return float(told["before"]) ** 2, float(told["after"]) ** 2, sum(oracle) / len(oracle)


def _explained(before: float, after: float, oracle: float, floor: float) -> float | None:
    """Share of what could be explained; ``None`` where that is below the noise floor's square."""
    explainable = before - oracle
    if not explainable > floor**2:
        return None
    return min(1.0, max(-1.0, (before - after) / explainable))
