"""Which names hold: a search, and what is taken back of what it found."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from scipy.stats import chi2

from sim.effects import Effect

from ..watch import Watch
from .faint import changes_little, contradicted
from .fit import Fit
from .floor import tolerance
from .growing import grow, paired
from .intervals import Spread, may_be_nothing
from .model import JointModel, Kind
from .rest import rest_of
from .search import (
    HARM,
    HELD_OUT,
    NEEDED,
    Gain,
    Outside,
    Progress,
    beside_others,
    drop,
    inside,
)
from .veto import AGREES, BEHIND, SPLIT, as_plainer, impossible, objection
from .worth import explains_little, mean_square, register_denies, rms_of, shown

WORSE = 1.2  #: times the mean square on recordings left out that takes a name back
IDLE = 0.05  #: share of the same by which a name that is not needed there may make them worse
SPOILT = 0.1  #: of the mean square that a name takes off the others, which must be spoilt there
SURE = 0.99  #: that an effect is there at all: what it gains, by the widest account of its size
#: share that names must take off the squared misfit of recordings that judge; and where more than
#: so many deviations of what is no physics are left. In cases of other engines whose effect was in
#: no catalogue neighbours took 0.44 to 0.59 and left 2.5 and more; true names, and those in public
#: logs, took 0.67 and more there
OUTSIDE, BULK, FAR_OFF = 0.05, 0.6, 2.0
HARMFUL = "it makes recordings that were not used to fit worse"
NEEDLESS = "recordings that were not used to fit are within noise without it, and worse with it"
BETTER = "it explains far less than a cause that cannot be named"
NOTHING = "its size may as well be nothing"
ALONE = "it gains nothing on recordings left out, beside what else is named"
BESIDE = "it explains little of a misfit of which much is left"
FAINT = "it changes nothing by more than two sound simulations of one joint differ by"
CONTRADICTED = "the motion is farther off with it, though other registers or its noise are likelier"
DENIED = "a register of duty or voltage is much farther off with it"
#: reasons that hang on what else is in a hypothesis: beside another cause a name may hold
HANGS = frozenset({BETTER, NOTHING, ALONE, BESIDE, FAINT, CONTRADICTED, DENIED})


Grown = tuple[Fit, Sequence[Gain], Sequence[Gain]]  #: a fit, its names, and all that was confirmed


@dataclass(frozen=True, slots=True)
class Denied:
    """A name that is taken back, why, and what those without it must gain together [nats]."""

    gain: Gain
    because: str
    needed: float = 0.0
    again: bool = True  #: whether a search without it may find another
    refuted: bool = False  #: its size or a register speaks against it, not only recordings


@dataclass(frozen=True, slots=True)
class Part:
    """A name of several, and the fit of what is left without it."""

    gain: Gain
    without: Fit
    own: Gain  #: what it gains over that


@dataclass(frozen=True, slots=True)
class Settled:
    """A fit, the names that hold, all that was confirmed, and what may be named at all."""

    after: Fit
    taken: Sequence[Gain]
    confirmed: Sequence[Gain]
    effects: Mapping[str, Effect]
    rejected: Sequence[Mapping[str, Any]]
    needed: float  #: what names must gain together [nats], after those that were taken back
    refuted: Collection[str] = ()  #: those of the rejected that cannot be what another could be

    @property
    def thought_of(self) -> Sequence[str]:
        """Names that hold, and those that were taken back."""
        return [gain.effect for gain in self.taken] + [row["effect"] for row in self.rejected]


def settle(
    model: JointModel,
    judge: JointModel | None,
    before: Fit,
    effects: Mapping[str, Effect],
    floor: float,
    floors: Mapping[Kind, float],
    watch: Watch,
    ask: Callable[[Fit], None] = lambda _: None,
    found: Grown | None = None,
) -> Settled:
    """Search, and take names back until nothing speaks against those that are left.

    ``judge`` has the recordings that were not used to fit, if there are any. After the first name
    that is taken back there is a second search without it; then names are only taken back, and once
    that is done it is looked what else gains beside those that are left. Where no name is left, the
    fit is the deeper of those without one. ``ask`` is asked of every step's fit.

    Where something structured is left, the best pair that begins otherwise is searched on from, and
    what comes of that is taken if it is likelier and leaves less on recordings that judge.
    ``found`` is what a search has found already: then it is only judged.
    """
    settling = _Settling(model, judge, before, floor, floors, watch, ask)
    if found is not None:
        return settling.settled(effects, found)
    first = settling.settled(effects, settling.grown(before, effects))
    if watch.stopped is not None or not settling.leaves(first.after):
        return first
    left = _without(effects, _firm(first.rejected))
    begun = paired(model, first.confirmed, left, watch)
    if begun is None or begun[0].cost > first.after.cost - NEEDED * begun[1][1].inflation:
        return first
    second = settling.settled(left, settling.grown(begun[0], left, begun[1]), first.needed)
    likelier = second.after.cost < first.after.cost
    judges = [judge or model]
    nearer = mean_square(judges, second.after) < mean_square(judges, first.after)
    if not (second.taken and likelier and nearer):
        return first
    rows = [row for row in first.rejected if row["effect"] not in second.thought_of]
    refuted = {*first.refuted, *second.refuted}
    return replace(second, rejected=[*rows, *second.rejected], refuted=refuted)


@dataclass(frozen=True, slots=True, eq=False)
class _Settling:
    """What names are judged by."""

    model: JointModel
    judge: JointModel | None
    before: Fit
    floor: float
    floors: Mapping[Kind, float]
    watch: Watch
    ask: Callable[[Fit], None]

    def grown(
        self, base: Fit, effects: Mapping[str, Effect], begun: Sequence[Gain] = (), most: int = 4
    ) -> Grown:
        """What a search finds, from a fit that has some effects already."""
        known = (dict(effects), self.watch, self.floors, most)
        return grow(self.model, base, *known, ask=self.ask, begun=begun)

    def leaves(self, found: Fit) -> bool:
        """Whether a fit leaves something structured."""
        return rest_of(self.model, self.judge or self.model, found, self.floor).structured

    def settled(self, effects: Mapping[str, Effect], grown: Grown, needed: float = 0.0) -> Settled:
        """What is left of a search once nothing speaks against it any more."""
        every = effects
        rejected: list[Mapping[str, Any]] = []
        refuted: set[str] = set()
        looked = False
        after, taken, confirmed = grown
        while True:
            taken = self._judged(after, taken)
            denied = self._denied(after, taken, effects, needed)
            if denied is None and rejected and taken and not looked and not self.watch.stopped:
                looked, alone = True, {gain.effect for gain in taken}
                others = _without(every, [*_firm(rejected[:-1]), rejected[-1]])
                after, taken, more = self.grown(after, others, taken, len(taken) + 1)
                confirmed = [*confirmed, *more]
                if (held := {gain.effect for gain in taken}) != alone:
                    rejected = [row for row in rejected if row["effect"] not in held]
                    effects = _without(every, rejected)
                    continue
            if denied is None:
                if not taken:
                    after = min(self.before, after, key=lambda found: found.cost)
                return Settled(after, taken, confirmed, effects, rejected, needed, refuted)
            needed = max(needed, denied.needed)
            name, nats = denied.gain.effect, float(denied.gain.deflated)
            rejected.append({"effect": name, "gain_nats": nats, "because": denied.because})
            refuted |= {name} if denied.refuted else set()
            effects = _without(effects, rejected)
            plainer = SPLIT[name] if denied.because.startswith(AGREES) else name
            if plainer in effects and plainer not in after.hypothesis.effects:
                after, gain = as_plainer(self.model, after, name, effects[plainer])
                taken = [gain if one.effect == name else one for one in taken]
                confirmed = [*confirmed, gain]
            elif len(rejected) == 1 and denied.again and self.watch.stopped is None:
                after, taken, confirmed = self.grown(self.before, effects)
            else:
                after, *_ = drop(self.model, after, name)
                taken = [gain for gain in taken if gain.effect != name]

    def _judged(self, after: Fit, taken: Sequence[Gain]) -> Sequence[Gain]:
        """The names, all judged on groups left out: those a pair was begun with never were."""
        if self.watch.stopped is not None or all(gain.held_out for gain in taken):
            return taken
        self.watch.tell("what is named, on recordings left out")
        pairs = [(gain, drop(self.model, after, gain.effect)[0]) for gain in taken]
        return beside_others(self.model, after, pairs, self.floors)

    def _denied(
        self, after: Fit, taken: Sequence[Gain], effects: Mapping[str, Effect], needed: float
    ) -> Denied | None:
        """The first name that something speaks against."""
        model, judge = self.model, self.judge
        if (denied := _objected(model, self.before, after, taken, effects, needed)) is not None:
            return denied
        parts = _parts(model, after, taken, self.watch.tell)
        denied = _faint(model, judge, after, parts)
        if denied is None and judge is not None:
            denied = _denied(model, judge, after, parts, self.floors)
        if denied is None:
            denied = _unsure(model, after, parts, self.floors)
        if denied is None:
            denied = _little(model, judge or model, self.before, after, parts, self.floor)
        return denied


def _firm(rejected: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Those of the rejected that no other cause beside them would make a name."""
    return [row for row in rejected if row["because"] not in HANGS]


def _without(effects: Mapping[str, Effect], rows: Sequence[Mapping[str, Any]]) -> dict[str, Effect]:
    """Effects but those of some rows."""
    names = {row["effect"] for row in rows}
    return {name: e for name, e in effects.items() if name not in names}


def _objected(
    model: JointModel,
    before: Fit,
    after: Fit,
    taken: Sequence[Gain],
    effects: Mapping[str, Effect],
    needed: float,
) -> Denied | None:
    """A name that something speaks against, or the last of those that explain far less."""
    explained = before.cost - after.cost
    for gain in taken:
        if (why := objection(model, after, gain, effects)) is not None:
            refuted = not why.startswith(AGREES)  # it may still be what the plainer one could be
            return Denied(gain, why, BEHIND * explained, refuted=refuted)
    if taken and explained < needed:
        return Denied(taken[-1], BETTER)
    return None


def _parts(model: JointModel, after: Fit, taken: Sequence[Gain], say: Progress) -> Sequence[Part]:
    """All names, the last one first, each with the fit of what is left without it."""
    parts = []
    for gain in taken[::-1]:
        say(f"without {gain.effect}")
        without, own = drop(model, after, gain.effect)
        parts.append(Part(gain, without, own))
    return parts


def _faint(
    model: JointModel, judge: JointModel | None, after: Fit, parts: Sequence[Part]
) -> Denied | None:
    """A name that positions or registers deny, or that changes next to nothing, sure or not."""
    everywhere = (model, judge) if judge is not None else (model,)
    for part in parts:
        nats = min(part.own.deflated, part.gain.outside)
        if changes_little(everywhere, part.without, after, part.gain.effect, nats):
            worse = contradicted(everywhere, part.without, after)
            return Denied(part.gain, CONTRADICTED if worse else FAINT, again=False)
        if register_denies(everywhere, part.without, after):
            return Denied(part.gain, DENIED)
    return None


def _denied(
    model: JointModel,
    judge: JointModel,
    after: Fit,
    parts: Sequence[Part],
    floors: Mapping[Kind, float],
) -> Denied | None:
    """The effect that does most harm to recordings that were not used to fit, if any does."""
    harms = []
    for part in parts[::-1]:
        mended = mean_square([model], part.without) - mean_square([model], after)
        squares = mean_square([judge], part.without), mean_square([judge], after)
        outside = inside(judge, part.without, after, floors)
        if (why := spoils(*squares, mended, outside, floors[Kind.POSITION])) is not None:
            harms.append((outside.harm, part.gain, why))
    if not harms:
        return None
    _, gain, why = max(harms, key=lambda entry: entry[0])
    return Denied(gain, why)


def spoils(
    without: float, with_it: float, mended: float, outside: Outside, floor: float
) -> str | None:
    """Why a name cannot hold by what it does to recordings that were not used to fit, if it cannot.

    ``without`` and ``with_it`` are mean squares of positions there [rad^2], ``mended`` is what it
    takes off that of those that were fitted, ``floor`` the deviation of noise [rad].
    """
    spoilt = with_it - without
    worse = spoilt > (WORSE - 1.0) * without
    if outside.harm > HARM and worse and spoilt > SPOILT * mended:
        return HARMFUL
    if without < floor**2 and spoilt > IDLE * without and outside.relief < outside.harm:
        return NEEDLESS
    return None


def _unsure(
    model: JointModel, after: Fit, parts: Sequence[Part], floors: Mapping[Kind, float]
) -> Denied | None:
    """A name of several that gains nothing beside the others, or whose size may be nothing."""
    if not parts:
        return None
    spread, count = Spread(model, after), len(model.nuisances)
    for part in parts:
        sizes = [
            count + i
            for i, knob in enumerate(after.hypothesis.knobs)
            if knob.effect == part.gain.effect and not knob.parameter.shape
        ]
        if not spread.seen_by_steps(sizes):
            continue
        likely = 2.0 * part.own.counted(spread.doubt(sizes))
        if likely < chi2.ppf(SURE, len(sizes)) or may_be_nothing(
            model, after, spread, part.gain.effect
        ):
            return Denied(part.gain, NOTHING, again=False)
    judged = [part.gain for part in parts]
    if len(parts) > 1:
        judged = beside_others(model, after, [(p.gain, p.without) for p in parts], floors)
    for gain in judged:
        if gain.held_out and gain.outside < HELD_OUT:
            return Denied(gain, ALONE, again=False)
    return None


def _little(
    model: JointModel,
    judge: JointModel,
    before: Fit,
    after: Fit,
    parts: Sequence[Part],
    floor: float,
) -> Denied | None:
    """A name that explains little, where much is left: the cause is another, or one more.

    What others do in its place counts for nothing where they would need sizes that nothing has.
    """
    if not parts or not rest_of(model, judge, after, floor).structured:
        return None
    everywhere = list(dict.fromkeys((model, judge)))
    unseen = [part for part in parts if not shown(everywhere, part.without, after)]
    for part in unseen:
        little = explains_little(everywhere, before, part.without, after, floor)
        if little and not impossible(model, part.without):
            return Denied(part.gain, BESIDE, again=False)
    if not unseen:
        return None
    was, left = rms_of(judge, before), rms_of(judge, after)
    needed = BULK if left > FAR_OFF * tolerance(floor) else OUTSIDE
    if left**2 > (1.0 - needed) * was**2:
        least = min(unseen, key=lambda part: part.own.deflated)
        return Denied(least.gain, BESIDE, again=False)
    return None
