"""A case: drawn from a seed, a rig with something hidden in it, and how it is concealed."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from bench.motions import ExperimentPlan

from .changes import Setting, Truth
from .effects import EFFECTS, Effect
from .host import Line, schedule
from .instant import OPEN, Gate, GateKind
from .mimic import ALIKE, Rival, nearest_rival
from .nuisances import Nuisances, Passing, draw_nuisances
from .rigs import RIGS, STYLES, Run
from .sizing import (
    RATIOS,
    Floats,
    Ground,
    Size,
    effect_named,
    noise_floor,
    observe,
    ratio_fitted,
    rms,
    size_for,
)
from .specimen import Build, Specimen
from .unlisted import STRANGERS

T = TypeVar("T")


class Kind(enum.Enum):
    """How many effects a case has, and whether they can be named."""

    NULL = "null"
    SINGLE = "single"
    PAIR = "pair"
    TRIPLE = "triple"
    STRANGER = "stranger"  #: physics that is in no catalogue
    DELETED = "deleted"  #: a single one, diagnosed with a catalogue that lacks it


class Concealment(enum.Enum):
    """How an effect is concealed."""

    PLAIN = "plain"
    MASKED = "masked"  #: by a larger ordinary misfit
    SUB_QUANTUM = "sub_quantum"  #: its trace lies below the quantisation step
    RARE = "rare"  #: a few per cent of the samples
    MIMICKED = "mimicked"  #: a rival gives nearly the same trace


#: share of the cases of each kind when none is asked for; a third are nulls
SHARES = {
    Kind.NULL: 0.34,
    Kind.SINGLE: 0.36,
    Kind.PAIR: 0.10,
    Kind.TRIPLE: 0.04,
    Kind.STRANGER: 0.08,
    Kind.DELETED: 0.08,
}
COUNT = {Kind.NULL: 0, Kind.PAIR: 2, Kind.TRIPLE: 3}
#: windows of the recordings in which a rare effect is there [s]
RARE_S = ((0.6, 0.9), (2.1, 2.4), (3.2, 3.6))
#: worn sectors of a gear [rad]
RARE_RAD = ((-0.12, 0.12), (0.3, 0.5), (-0.6, -0.4))
CHOICES = (0.0, 0.5, 1.0)
#: concealments that need an effect of the catalogue which can be rare, or has rivals
BY_CATALOGUE = (Concealment.RARE, Concealment.MIMICKED)
#: it is there or not: its trace has no small sizes
ABRUPT = "overload_shutdown"
SPRINGY = "joint_compliance"
FAR = 2.0  #: a trace that jumps past the ratio asked for by more than this is another case
#: share of the ratio asked for that an effect must have in the recordings to fit, as the case
#: truly is: a gain that masks may keep a duty below the limit that is hidden
THERE = 0.25
STRUCK = 3.0  #: failed reads to be expected in them, where reads fail: else there may be none
DRAWS = 60
#: of a case that shall be mimicked: every draw looks for rivals of the same size, which may take
#: minutes where gears are springs, and is then concealed plainly in a proof
MIMICS = 10


@dataclass(frozen=True, slots=True)
class Hidden:
    """An effect in a case: its size, what it is in units of the floor, and what it was to be."""

    name: str
    size: float
    ratio: float
    wanted: float
    how: Setting

    @property
    def effect(self) -> Effect:
        """The effect itself."""
        return effect_named(self.name)

    def on(self, specimen: Specimen) -> tuple[Specimen, Truth]:
        """A specimen with it, and its true parameters."""
        return self.effect.apply(specimen, self.size, self.how)


@dataclass(frozen=True, slots=True)
class Asked:
    """What a caller may fix; the seed draws the rest."""

    kind: str | None = None
    effects: tuple[str, ...] = ()
    ratio: float | None = None
    concealment: str | None = None
    rig: str | None = None
    style: str | None = None
    programme: str | None = None
    disguise: bool | None = None

    def document(self) -> dict[str, Any]:
        """As plain values; :meth:`of` reads it."""
        return dataclasses.asdict(self)

    @classmethod
    def of(cls, document: dict[str, Any]) -> Asked:
        """From plain values."""
        return cls(**{**document, "effects": tuple(document["effects"])})


@dataclass(frozen=True)
class Case:
    """What is true of one case. ``ordinary`` are misfits that mask; they are true as well."""

    seed: int
    asked: Asked
    kind: Kind
    concealment: Concealment
    ground: Ground
    hidden: tuple[Hidden, ...]
    ordinary: tuple[Hidden, ...]
    nuisances: Nuisances
    disguised: bool
    rival: Rival | None = None  #: of the first effect, where that is mimicked

    def specimen(self, plan: ExperimentPlan, passing: Passing | None = None) -> Specimen:
        """The hidden specimen as it is in one recording."""
        specimen, _ = self.truth(plan)
        return specimen if passing is None else passing.on(specimen)

    def truth(self, plan: ExperimentPlan) -> tuple[Specimen, list[tuple[Hidden, Truth]]]:
        """The hidden specimen under a plan, and what is true of every effect in it."""
        specimen = self.ground.specimen(plan.payload_kg)
        if plan.payload_at_m is not None:
            specimen = specimen.but(payload_at_m=plan.payload_at_m)
        specimen = self.nuisances.on(specimen)
        found = []
        for hidden in (*self.ordinary, *self.hidden):
            specimen, truth = hidden.on(specimen)
            found.append((hidden, truth))
        return specimen, found

    def without(self, index: int) -> Case:
        """The same case without one of its hidden effects."""
        return dataclasses.replace(self, hidden=self.hidden[:index] + self.hidden[index + 1 :])

    def fitted_trace(self, channel: str) -> Floats:
        """A register's traces [its SI unit] in the runs for fitting, one after another."""
        style = self.ground.style
        found = [observe(style, run, self.specimen(run.plan), channel) for run in self.fitted]
        return np.concatenate(found)

    @property
    def fitted(self) -> tuple[Run, ...]:
        """What is recorded for fitting."""
        programme = self.ground.programme
        return tuple(run for run in programme.runs if run.group not in programme.held_out)

    @property
    def plans(self) -> tuple[tuple[str, ExperimentPlan], ...]:
        """Group and plan of every recording, repeats one after another."""
        return tuple(
            (run.group, run.plan) for run in self.ground.programme.runs for _ in range(run.repeats)
        )


def draw(seed: int, asked: Asked | None = None) -> Case:
    """Draw a case; the same seed and wishes give the same case.

    Raises ``ValueError`` where what is asked for cannot be had, and says what to ask for instead.
    """
    asked = asked or Asked()
    random = np.random.default_rng([seed, 20])
    kind = Kind(asked.kind) if asked.kind else _any(random, list(SHARES), list(SHARES.values()))
    draws = MIMICS if asked.concealment == Concealment.MIMICKED.value else DRAWS
    for _ in range(draws):
        case = _try(seed, asked, kind, random)
        if case is not None:
            return case
    raise ValueError(
        f"no case in {draws} draws: {', '.join(asked.effects) or kind.value} does not reach "
        "the ratio asked for on such a rig, or no rival is like it where it shall be mimicked: "
        "ask for a smaller ratio, or leave rig and concealment open"
    )


def _any(
    random: np.random.Generator, choices: list[Any], weights: list[float] | None = None
) -> Any:
    share = None if weights is None else np.array(weights) / sum(weights)
    return choices[int(random.choice(len(choices), p=share))]


def _named(what: str, known: Mapping[str, T], name: str) -> T:
    """One of the known by its name. Raises ``ValueError`` with those there are."""
    if name not in known:
        raise ValueError(f"no {what} named {name!r}: use one of {', '.join(known)}")
    return known[name]


def _try(seed: int, asked: Asked, kind: Kind, random: np.random.Generator) -> Case | None:
    rig = _named("rig", RIGS, asked.rig or _any(random, list(RIGS)))
    style = _named("style", STYLES, asked.style or _any(random, list(STYLES), [0.6, 0.2, 0.2]))
    drawn = asked.programme or _any(random, [p.name for p in rig.programmes()])
    programme = _named("programme", rig.by_name(), drawn)
    if asked.concealment:
        concealment = Concealment(asked.concealment)
    elif kind is Kind.NULL:
        concealment = Concealment.PLAIN
    elif asked.effects and not all(
        _can(name, kind_) for name in asked.effects for kind_ in BY_CATALOGUE
    ):
        concealment = _any(random, [c for c in Concealment if c not in BY_CATALOGUE])
    else:
        concealment = _any(random, list(Concealment), [0.3, 0.2, 0.15, 0.15, 0.2])
        if kind is Kind.STRANGER and concealment in BY_CATALOGUE:
            concealment = Concealment.PLAIN
    names = _names(asked, kind, concealment, random)
    where = Ground(rig, programme, style, _build(names, random))
    hidden: list[Hidden] = []
    for name in names:
        found = _hide(where, name, asked, concealment, random)
        if found is None:
            return None
        hidden.append(found)
    rival = None
    if concealment is Concealment.MIMICKED:
        first = hidden[0]
        rival = nearest_rival(where.key, first.name, Size(first.size, first.ratio), first.how)
        if rival is None or rival.unlike > ALIKE:
            return None
    ordinary: tuple[Hidden, ...] = ()
    if concealment is Concealment.MASKED:
        ordinary = (_mask(where, names, random),)
    nuisances = draw_nuisances(random, rig.sheet.rated_voltage_v)
    pinned = {pin for h in (*hidden, *ordinary) for pin in h.effect.pins}
    none = Nuisances()
    plain: dict[str, Any] = {pin: getattr(none, pin) for pin in pinned}
    nuisances = dataclasses.replace(nuisances, **plain)
    if ABRUPT in names:
        seen = [_as_it_is(where, one, nuisances) for one in hidden]
        if any(one.ratio < one.wanted for one in seen):
            return None
        hidden = seen
    disguised = bool(random.random() < 0.2) if asked.disguise is None else asked.disguise
    case = Case(
        seed=seed,
        asked=asked,
        kind=kind,
        concealment=concealment,
        ground=where,
        hidden=tuple(hidden),
        ordinary=ordinary,
        nuisances=nuisances,
        disguised=disguised and bool(hidden),
        rival=rival,
    )
    return case if _is_there(case) else None


def _build(names: list[str], random: np.random.Generator) -> Build:
    """One way or the other, as likely; a gear is more springy than its file says only if sprung."""
    sprung, presliding = (random.random(2) < 0.5).tolist()
    return Build(sprung or SPRINGY in names, presliding)


def _is_there(case: Case) -> bool:
    """Whether every hidden effect does something to the recordings that are for fitting."""
    for index, one in enumerate(case.hidden):
        channel = one.effect.channel
        change = rms(case.fitted_trace(channel) - case.without(index).fitted_trace(channel))
        if change < THERE * one.wanted * noise_floor(case.ground.key, channel):
            return False
    struck = expected_failures(case)
    return struck == 0.0 or struck >= STRUCK


def expected_failures(case: Case) -> float:
    """How many reads of a position are expected to fail in the recordings for fitting."""
    line, chance = Line(latency_s=0.0), np.random.default_rng(0)
    return sum(
        case.specimen(run.plan).sensing.outlier_rate
        * run.repeats
        * len(schedule(case.ground.style, run.plan.motion.duration_s, line, chance).sample_s)
        for run in case.fitted
    )


def _as_it_is(where: Ground, hidden: Hidden, nuisances: Nuisances) -> Hidden:
    """What is there or not, with the ratio it has in the groups for fitting, as the rig truly is.

    On a rig that is only a little off, a duty may never be high for long enough.
    """
    found = ratio_fitted(where, hidden.name, hidden.size, hidden.how, nuisances)
    return dataclasses.replace(hidden, ratio=found)


def _names(
    asked: Asked, kind: Kind, concealment: Concealment, random: np.random.Generator
) -> list[str]:
    count = COUNT.get(kind, 1)
    if asked.effects:
        if len(asked.effects) != count:
            raise ValueError(f"a case of kind {kind.value} has {count} effects: name so many")
        for name in asked.effects:
            if not _can(name, concealment):
                raise ValueError(f"{name} cannot be {concealment.value}: leave that open")
        return list(asked.effects)
    pool = STRANGERS if kind is Kind.STRANGER else EFFECTS
    names = [
        name
        for name in pool
        if _can(name, concealment)
        and not (name == ABRUPT and (count > 1 or concealment is not Concealment.PLAIN))
    ]
    return [names[i] for i in random.permutation(len(names))[:count]]


def _can(name: str, concealment: Concealment) -> bool:
    """Whether an effect can be concealed that way."""
    effect = effect_named(name)
    if concealment is Concealment.RARE:
        return bool(effect.gates)
    return bool(effect.rivals) or concealment is not Concealment.MIMICKED


def _hide(
    where: Ground,
    name: str,
    asked: Asked,
    concealment: Concealment,
    random: np.random.Generator,
) -> Hidden | None:
    effect = effect_named(name)
    wanted = asked.ratio or float(_any(random, list(RATIOS)))
    if effect.channel != "present_position" and "duty" not in where.style.reads:
        return None
    if name == "com_offset" and where.rig.upright:
        return None
    gate = OPEN
    if concealment is Concealment.RARE and effect.gates:
        kind = effect.gates[0]
        low, high = _any(random, list(RARE_S if kind is GateKind.TIME else RARE_RAD))
        gate = Gate(kind, low, high)
    if concealment is Concealment.SUB_QUANTUM:
        below = 0.95 * where.rig.sheet.step_rad / noise_floor(where.key)
        fitting = [ratio for ratio in RATIOS if ratio <= min(below, wanted)]
        if not fitting:
            return None
        wanted = fitting[-1]
    sign = int(_any(random, [-1, 1])) if effect.signed else 1
    how = Setting(sign, float(_any(random, list(CHOICES))), gate)
    found = size_for(where.key, name, wanted, how)
    if found is None or (found.ratio > FAR * wanted and name != ABRUPT):
        return None
    return Hidden(name, found.size, found.ratio, wanted, how)


def _mask(where: Ground, names: list[str], random: np.random.Generator) -> Hidden:
    """A gain 20 % off, or a mass 15 % off: counted from the nuisance's bound."""
    heavier = max(where.rig.payloads_kg) > 0.5 * where.rig.arm.mass_kg
    masses = ("payload", 0.10 * where.rig.payloads_kg[-1]) if heavier else ("link_mass", 0.10)
    choices = [c for c in (("gain_error", 0.10), masses) if c[0] not in names] or [
        ("supply_voltage", 0.10)
    ]
    name, size = _any(random, choices)
    sign = int(_any(random, [-1, 1])) if effect_named(name).signed else 1
    return Hidden(name, size, float("nan"), float("nan"), Setting(sign))
