"""What a whole robot's model left out: effects at places, one by one, while they gain.

The likelihood, the fits and what a gain must be divided by are those of one joint. An effect is
taken when it gains enough on what it is fitted to and, where there are several groups of
recordings, on those left out. The search goes on from there; in the end effects are dropped again
without which the rest does as well. Where two show only together, no step finds the first of them:
such pairs are tried as one. So are the first that was taken and what gained most in its place,
where nothing is found beside it and far more than noise is left.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..joint.rivals import CLOSE
from ..watch import OutOfTimeError
from .effects import ONE_WITH, Placed, leg_of
from .fit import ENOUGH, RobotFit
from .gains import HOPELESS, NEEDED, RobotFindings, RobotGain
from .screen import Screen, stretched, worth_fitting
from .sought import Pair, Sought, opposed
from .steps import BESIDE, Steps, much_worse

Floats = NDArray[np.float64]
MOST = 3  #: effects that are taken
AT_END = 0.99  #: share of what a tolerance may be, from which it is at its end


def with_next(first: RobotGain, tried: Sequence[RobotGain]) -> tuple[Pair, ...]:
    """A gain, and what gained most in its place if that is enough, each as it was alone.

    Beside a robot that can hardly stand with one of them, traces lead astray from the other: it is
    found neither beside it nor where a fit of both begins.
    """
    effect = first.name.partition("@")[0]
    others = [gain for gain in tried if gain.name.partition("@")[0] != effect]
    best = max(others, key=lambda gain: gain.deflated, default=None)
    if best is None or best.deflated < BESIDE:
        return ()
    knobs = float(first.fit.knobs[-1]), float(best.fit.knobs[-1])
    return (Pair((first.name, best.name), knobs, anyhow=True),)


class RobotSearch(Steps):
    """A search on some recordings of a model, with some kinds of channels."""

    def run(
        self,
        most: int = MOST,
        without: Collection[str] = (),
        base: RobotFit | None = None,
        done: Callable[[RobotFit], bool] = lambda _: False,
        far: Callable[[RobotFit], bool] = lambda _: False,
        volts: Callable[[RobotFit], float] = lambda _: 0.0,
    ) -> RobotFindings:
        """Search among placed effects, of legs only where legs stand out.

        ``without`` are effects of the catalogue that are left out, ``base`` is what the operator
        believes if that was fitted. Beside a fit that is ``done`` nothing is tried but what had
        gained in place of what it has; and pairs where it is ``far`` from what was recorded, or
        where nothing more holds and servos show so many ``volts`` more than a fit has.
        """
        base = base or self.believed()
        self.around(base)
        first = self.screen(base)
        wanted = self._wanted(first, base, without)
        ranking, now = first.rank(wanted), base
        screened = tuple(ranking)
        taken: list[RobotGain] = []
        tried: list[tuple[RobotGain, ...]] = []
        alone: list[tuple[RobotGain, ...]] = []  # that a pair was better than: in place of none
        sought = self._sought(wanted)
        try:
            while len(taken) < most:
                named = stretched(self.model.nuisances, now.nuisances)
                gains = sought.beside(
                    now, self._step(worth_fitting(ranking, named), now, len(taken))
                )
                chosen, now, fitted = self._chosen(now, gains, named | sought.asked(gains))
                base = base if now.names else now
                tried.append(fitted)
                sought = sought.after(fitted)
                bare = now
                if chosen is not None:
                    now, taken = chosen.fit, [*taken, chosen]
                pair: list[tuple[RobotGain, ...]] = []
                kept = 0  # of what is taken, beside a pair
                if len(tried) == 1:
                    pair = self._together(sought.pairs, bare, fitted, chosen)
                elif len(taken) == 1 and far(now):
                    most = 2  # what such a robot does beside two is chance
                    one = replace(taken[0], fit=now)
                    pair = self._together(with_next(one, tried[0]), base, tried[0], one)
                if not pair and now is bare and len(taken) + 1 < most:
                    pair, kept = self._hidden(now, volts(now), wanted), len(taken)
                if pair:
                    alone, tried = [*alone, *tried[kept:]], [*tried[:kept], *pair]
                    taken = [*taken[:kept], *(step[0] for step in pair)]
                    now = taken[-1].fit
                over = done(now)
                sought = sought.rivals(now) if over else sought
                if now is bare or len(taken) >= most or (over and not sought.at):
                    break
                left = [] if over else [name for name in wanted if name not in now.names]
                ranking = self.screen(now).rank(left)
            now, taken, tried = self._exchanged(now, taken, tried)
            now, taken, tried = self._united(now, taken, tried)
        except OutOfTimeError:
            self.around(now)  # what was taken until then is told
        alike = {
            g.name: self._alike(first, g, s, wanted) for g, s in zip(taken, tried, strict=False)
        }
        pruned, taken = self._prune(now, taken)
        now = self.settle(pruned) if taken else pruned  # as those are that it is judged by
        now, taken = self._standing(base, now, taken)
        return RobotFindings(base, now, tuple(taken), (*tried, *alone), alike, screened)

    def _wanted(self, first: Screen, base: RobotFit, without: Collection[str]) -> list[str]:
        """Effects at places that are looked at; those of the catalogue ``without`` are left out."""
        placed = self.model.placed
        looked = self._worth_looking(first, stretched(self.model.nuisances, base.nuisances))
        wanted = [name for name in looked if not placed[name].left_out(without)]
        self._say(f"replaying {len(wanted)} effects")
        return wanted

    def _sought(self, names: Collection[str]) -> Sought:
        return Sought.much(self.sight, names)

    def believed(self) -> RobotFit:
        """What the operator believes, with all that is never exactly so."""
        self._say("fitting what the operator believes")
        return self.thoroughly((), np.empty(0))

    def nothing(self, base: RobotFit) -> RobotFindings:
        """That what the operator believes is all there is to say."""
        return RobotFindings(base, base, (), (), {}, ())

    def _hidden(
        self, now: RobotFit, more_v: float, names: Collection[str]
    ) -> list[tuple[RobotGain, ...]]:
        """A supply and a gain that hides it, beside a fit, if servos show so much another [V]."""
        return self._together(opposed(self.sight, now, more_v, names), now, (), None)

    def _together(
        self,
        pairs: Sequence[Pair],
        now: RobotFit,
        tried: Sequence[RobotGain],
        chosen: RobotGain | None,
    ) -> list[tuple[RobotGain, ...]]:
        """Two effects that together gain much more than the best alone, and none without the other.

        Nothing else finds them: with one of them alone a robot is as far off as with neither. Two
        steps, of the pair that gains most; beside its first effect others that hold with the same.
        """
        alone = now if chosen is None else chosen.fit
        found: list[list[RobotGain]] = []
        for pair in pairs:
            names, knobs = (*now.names, *pair.names), np.append(now.knobs, pair.knobs)
            told = " and ".join(pair.names)
            self._say(f"trying {told}")
            with self.model.following():
                if pair.anyhow:
                    begun = self.begun(names, knobs, now.noise, alone.nuisances)
                else:
                    begun = self.begun(names, knobs, now.noise, most=alone.cost)
                    if begun.cost > alone.cost - BESIDE:
                        continue
                self._say(f"replaying what is ordinary beside {told}")
                refined = self.refined(begun)
            fit = self.replayed(refined)
            bare = [self._without(name, fit, tried) for name in pair.names]
            gains = [
                self._of_pair(name, fit, one) for name, one in zip(pair.names, bare, strict=True)
            ]
            worse = much_worse(self._whole_square(fit), self._whole_square(now))
            more = [replace(gain, nats=alone.cost - fit.cost).counting(alone) for gain in gains]
            if worse or min(more) < BESIDE:
                continue
            if all(self._holds(gain, one) for gain, one in zip(gains, bare, strict=True)):
                found.append(gains)
        best = min(found, key=lambda gains: gains[0].fit.cost, default=None)
        if pairs:
            self.around(alone if best is None else best[0].fit)
        if best is None:
            return []
        first, second = best
        others = (one for one, other in found if one is not first and other.name == second.name)
        return [(first, *others), (second,)]

    def _without(self, name: str, fit: RobotFit, tried: Sequence[RobotGain]) -> RobotFit:
        """A fit without one of its effects, or with the others alone the best that is known."""
        without = self.settle(self.sight.without(fit, name))
        known = [gain.fit for gain in tried if gain.fit.names == without.names]
        return min([without, *known], key=lambda other: other.cost)

    def _of_pair(self, name: str, fit: RobotFit, without: RobotFit) -> RobotGain:
        """What one effect gains over a fit without it."""
        gain = RobotGain(name, fit, 0.0, self.sight.inflation(fit, name), None)
        return self._with(gain, without, fit, self._left_out(without))

    def _exchanged(
        self, now: RobotFit, taken: Sequence[RobotGain], tried: Sequence[tuple[RobotGain, ...]]
    ) -> tuple[RobotFit, list[RobotGain], list[tuple[RobotGain, ...]]]:
        """The best of each step but the last, or the next best where that does better in the end.

        What was found later may have decided between them. The fit, what is taken, what was tried.
        """
        taken, tried = list(taken), list(tried)
        for k, gain in enumerate(taken[:-1]):
            other = next((each for each in tried[k] if each.name not in now.names), None)
            if other is None:
                continue
            self._say(f"trying {other.name} in place of {gain.name}")
            at, knobs = now.names.index(gain.name), now.knobs.copy()
            knobs[at] = other.fit.knobs[-1]
            names = (*now.names[:at], other.name, *now.names[at + 1 :])
            fit = self.thoroughly(names, knobs, now.noise, most=now.cost + HOPELESS)
            if fit.cost > now.cost + HOPELESS:
                continue
            before, after = self._left_out(now), self._left_out(fit)
            outside = gain.held_out
            if outside is not None and before is not None and after is not None:
                outside += before - after
            nats = gain.nats + now.cost - fit.cost
            better = replace(other, fit=fit, nats=nats, held_out=outside)
            # what is the less likely of two that are one must be ahead by more than chance
            needed = other.apart if ONE_WITH.get(other.name) == gain.name else ENOUGH
            if fit.cost > now.cost - needed or not self._holds(better, now):
                continue
            taken[k], now = better, fit
            tried[k] = (better, *(each for each in tried[k] if each is not other))
        self.around(now)
        return now, taken, tried

    def _united(
        self, now: RobotFit, taken: Sequence[RobotGain], tried: Sequence[tuple[RobotGain, ...]]
    ) -> tuple[RobotFit, list[RobotGain], list[tuple[RobotGain, ...]]]:
        """One effect that was taken at two places as one at both, where that does as well.

        What is soft in femurs and in tibiae was found in one of them first. The fit, what is taken,
        what was tried.
        """
        taken, tried = list(taken), list(tried)
        for one, other in combinations(taken, 2):
            name = self._at_both(one.name, other.name)
            if name is None:
                continue
            self._say(f"trying {name} in place of {one.name} and {other.name}")
            knobs = dict(now.settings)
            knob = 0.5 * (knobs.pop(one.name) + knobs.pop(other.name))
            every = np.array([*knobs.values(), knob])
            fit = self.thoroughly((*knobs, name), every, now.noise, now.nuisances)
            wide = self.sight.inflation(fit, name)
            if (fit.cost - now.cost) / wide >= NEEDED:
                self.around(now)
                continue
            outside = None
            if one.held_out is not None and other.held_out is not None:
                outside = one.held_out + other.held_out
            nats = one.nats + other.nats + now.cost - fit.cost
            both = RobotGain(name, fit, nats, wide, outside)
            k, gone = taken.index(one), taken.index(other)
            taken[k], tried[k] = both, (both, *tried[k])
            tried.append(tried.pop(gone))  # a step of nothing that is taken
            del taken[gone]
            self.around(fit)
            return fit, taken, tried
        return now, taken, tried

    def _at_both(self, one: str, other: str) -> str | None:
        """The effect that two of one kind are at both their places, if that is one of its own."""
        first, second = self.model.placed[one], self.model.placed[other]
        if first.effect is not second.effect or first.parameter is not second.parameter:
            return None
        alike = [
            (name, placed)
            for name, placed in self.model.placed.items()
            if placed.effect is first.effect and placed.parameter is first.parameter
        ]
        joints = [joint.name for joint in self.model.base.joints]

        def where(placed: Placed) -> frozenset[str]:
            return frozenset(placed.where or joints)

        both = where(first) | where(second)
        return next((name for name, placed in alike if where(placed) == both), None)

    def screen(self, now: RobotFit) -> Screen:
        """A screening of what a fit leaves, on the recordings of one motion: fits take them all."""
        like = self.model.like
        some = [r for r in self.which if like[r] == like[self.which[0]]]
        ends = np.array([nuisance.ends for nuisance in self.model.nuisances]).T
        held = (now.nuisances <= AT_END * ends[0]) | (now.nuisances >= AT_END * ends[1])
        at = np.where(held, now.nuisances, 0.0)
        left = [
            {
                kind: self.model.recorded(r, kind) - rows
                for kind, rows in self.model.modelled(now.settings, at, r).items()
            }
            for r in range(len(self.model.features))
        ]
        noise = dict(now.noise)
        return Screen(self.model, noise, left, self.sight.kinds, some, now.names, held)

    def _worth_looking(self, screen: Screen, named: Collection[str]) -> list[str]:
        """All that is everywhere or of a kind or ``named``, and places in legs that stand out."""
        legs = {leg.name for leg in self.model.base.legs}
        joints = {joint.name for joint in self.model.base.joints}
        worst = set(screen.standing_out())
        names = []
        for name in self.model.placed:
            place = name.partition("@")[2]
            leg = leg_of(place, legs)
            stands_out = leg in worst and (place in worst or place not in joints)
            if not leg or stands_out or name in named:
                names.append(name)
        return names

    def _alike(
        self, screen: Screen, chosen: RobotGain, gains: Sequence[RobotGain], names: Sequence[str]
    ) -> tuple[tuple[str, float], ...]:
        found = dict(screen.alike(chosen.name, names))
        for gain in gains:
            if gain.name != chosen.name and chosen.ahead_of(gain) < CLOSE:
                found.setdefault(gain.name, 1.0)
        return tuple(sorted(found.items(), key=lambda pair: -abs(pair[1])))

    def _prune(self, now: RobotFit, taken: list[RobotGain]) -> tuple[RobotFit, list[RobotGain]]:
        while len(taken) > 1:
            losses = []
            for gain in taken:
                without = self.sight.without(now, gain.name)
                wide = min(self.sight.inflation(now, gain.name), gain.inflation)
                losses.append(((without.cost - now.cost) / wide, gain, without))
            loss, gain, without = min(losses, key=lambda entry: entry[0])
            if loss >= NEEDED:
                break
            now, taken = without, [g for g in taken if g is not gain]
        return now, taken

    def _standing(
        self, base: RobotFit, now: RobotFit, taken: list[RobotGain]
    ) -> tuple[RobotFit, list[RobotGain]]:
        """Effects that together make no whole recording much worse; the last go first.

        What is left goes on as it was before the last, if that is deeper than where it leads.
        """
        begun = self._whole_square(base) if taken else 0.0
        while taken and much_worse(self._whole_square(now), begun):
            *taken, last = taken
            bare = self.settle(self.sight.without(now, last.name)) if taken else base
            known = [gain.fit for gain in taken if gain.fit.names == bare.names]
            now = min([bare, *known], key=lambda fit: fit.cost)
        return now, taken
