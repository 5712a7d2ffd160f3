"""What a whole robot's model left out: effects at places, one by one, while they gain.

The likelihood, the fits and what a gain must be divided by are those of one joint. An effect is
taken when it gains enough on what it is fitted to and, where there are several groups of
recordings, on those left out. Where tolerances had paid for it, it gains that they need not, and
nothing on those: it must gain more then, and lose no more there than fits of one hypothesis end
apart by. Then exactly that robot is replayed, and the search goes on from there; in the end effects
are dropped again without which the rest does as well.

Every hypothesis begins as believed but for its effects: where tolerances have paid for what is the
matter, no small step leads back from. And what it is held against is fitted again from where the
best of them has led, as what begins elsewhere may end deeper by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .rivals import CLOSE
from .robot_effects import leg_of
from .robot_exact import ExactFits
from .robot_features import MEANS, RobotKind
from .robot_fit import ENOUGH, RobotFit
from .robot_gains import NEEDED, RobotFindings, RobotGain, levelled
from .robot_improved import knob_of, of_settings
from .robot_judging import judge, rmse_rad
from .robot_model import RobotModel
from .robot_screen import Screen, Screened, stretched, worth_fitting
from .robot_sought import Sought
from .watch import OutOfTimeError

Floats = NDArray[np.float64]
Progress = Callable[[str], None]

#: gain [nats, deflated] of an effect beside others, as it may take up what those leave unexplained,
#: and of one that gains nothing on groups of recordings left out
BESIDE = 15.0
HELD_OUT = 1.5  #: gain [nats, deflated] on groups of recordings left out, of one that gains less
MOST = 3  #: effects that are taken
AT_END = 0.99  #: share of what a tolerance may be, from which it is at its end
WORSE = 1.5  #: times the mean square of a whole recording that no effect may make of it
PROMISED = 3  #: effects of a step that are tried, beside those for a tolerance at its end
BEST = 2  #: of them that are fitted to the end
TRIED = (0.3, 1.0, 3.0, 8.0)  #: in first tries, where fits start


class RobotSearch(ExactFits):
    """A search on some recordings of a model, with some kinds of channels."""

    def __init__(
        self,
        model: RobotModel,
        which: Sequence[int] | None = None,
        kinds: Iterable[RobotKind] = MEANS,
        say: Progress = lambda _: None,
    ) -> None:
        super().__init__(model, which, kinds)
        self._say = say

    def run(
        self,
        most: int = MOST,
        without: Collection[str] = (),
        base: RobotFit | None = None,
        done: Callable[[RobotFit], bool] = lambda _: False,
    ) -> RobotFindings:
        """Search among placed effects, of legs only where legs stand out.

        ``without`` are effects of the catalogue that are left out, ``base`` is what the operator
        believes if that was fitted. Of a fit that is ``done`` nothing more is asked.
        """
        model = self.model
        base = base or self.believed()
        self.around(base)
        first = self.screen(base)
        looked = self._worth_looking(first)
        wanted = [name for name in looked if model.placed[name].effect.name not in without]
        self._say(f"replaying {len(wanted)} effects")
        ranking = first.rank(wanted)
        screened = tuple(ranking)
        now, taken, tried = base, [], []
        sought = self._sought(wanted)
        try:
            for step in range(most):
                named = stretched(model.nuisances, now.nuisances)
                gains = self._step(worth_fitting(ranking, named), now, step)
                gains = sought.beside(now, gains)
                chosen, now, fitted = self._chosen(now, gains, named | sought.asked(gains))
                base = base if now.names else now
                tried.append(fitted)
                sought = sought.after(fitted)
                if chosen is None:
                    break
                now = chosen.fit
                taken.append(chosen)
                if step + 1 == most or done(now):
                    break
                ranking = self.screen(now).rank(n for n in wanted if n not in now.names)
            now, taken, tried = self._exchanged(now, taken, tried)
        except OutOfTimeError:
            self.around(now)  # what was taken until then is told
        alike = {
            g.name: self._alike(first, g, s, wanted) for g, s in zip(taken, tried, strict=False)
        }
        pruned, taken = self._prune(now, taken)
        now = now if pruned is now else self.settle(pruned)
        now, taken = self._standing(base, now, taken)
        return RobotFindings(base, now, tuple(taken), tuple(tried), alike, screened)

    def _sought(self, names: Iterable[str]) -> Sought:
        return Sought.much(self.sight, names)

    def believed(self) -> RobotFit:
        """What the operator believes, with all that is never exactly so."""
        self._say("fitting what the operator believes")
        return self.thoroughly((), np.empty(0))

    def nothing(self, base: RobotFit) -> RobotFindings:
        """That what the operator believes is all there is to say."""
        return RobotFindings(base, base, (), (), {}, ())

    def _chosen(
        self, now: RobotFit, promised: Sequence[RobotGain], named: Collection[str]
    ) -> tuple[RobotGain | None, RobotFit, tuple[RobotGain, ...]]:
        """The gain that holds best, if one does; what it gains over; all that was tried.

        What it gains over is fitted again from where the best of them has led. The best is first.
        """
        tried = self._tried(now, promised, named)
        plain, begun = self._left_out(now), self._whole_square(now)
        few = [self._with(gain, now, self._further(gain), plain) for gain in tried[:BEST]]
        chosen = self._best(few, now, begun)
        if chosen is not None:
            self._say(f"replaying much of {chosen.name}")
            far = self._with(chosen, now, self._from_far(chosen.fit), plain)
            if far.nats > chosen.nats + ENOUGH and self._best([chosen, far], now, begun) is far:
                few[few.index(chosen)] = chosen = far
        asked: set[str] = set()
        while chosen is not None and chosen.name not in asked:
            asked.add(chosen.name)
            self._say(f"asking what is ordinary to do without {chosen.name}")
            nuisances = chosen.fit.nuisances
            again = self.thoroughly(now.names, now.knobs, now.noise, nuisances)
            if again.cost > now.cost - ENOUGH:
                break
            now, plain = again, self._left_out(again)
            few = [self._with(gain, now, gain.fit, plain) for gain in few]
            chosen = self._best(few, now, self._whole_square(now))
        behind = [few[0].nats + tried[0].fit.cost - gain.fit.cost for gain in tried[BEST:]]
        rest = [replace(g, nats=nats) for g, nats in zip(tried[BEST:], behind, strict=True)]
        self.around(now if chosen is None else chosen.fit)
        return chosen, now, tuple(sorted([*few, *rest], key=lambda gain: -gain.deflated))

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
            fit = self.thoroughly(names, knobs, now.noise)
            before, after = self._left_out(now), self._left_out(fit)
            outside = gain.held_out
            if outside is not None and before is not None and after is not None:
                outside += before - after
            nats = gain.nats + now.cost - fit.cost
            better = replace(other, fit=fit, nats=nats, held_out=outside)
            if fit.cost > now.cost - ENOUGH or not self._holds(better, now):
                continue
            taken[k], now = better, fit
            tried[k] = (better, *(each for each in tried[k] if each is not other))
        self.around(now)
        return now, taken, tried

    def _tried(
        self, now: RobotFit, promised: Sequence[RobotGain], named: Collection[str]
    ) -> list[RobotGain]:
        """What promises most, and what stands for a tolerance at its end (``named``); best first.

        Fits begin as believed but for what is taken, and with what nuisances do there: promises are
        wrong by more than what they are of.
        """
        beyond = self._beyond(now)
        most = sorted(promised, key=lambda gain: -gain.nats)[:PROMISED]
        tried = []
        for gain in promised:
            if gain.name in named or (gain in most and gain.nats >= NEEDED):
                self._say(f"trying {gain.name}")
                knobs = np.append(now.knobs, beyond.get(gain.name, gain.fit.knobs[-1]))
                with self.model.following():
                    fit = self.begun(gain.fit.names, knobs, now.noise)
                tried.append(replace(gain, fit=fit))
        return sorted(tried, key=lambda gain: gain.fit.cost)

    def _further(self, gain: RobotGain) -> RobotFit:
        """A gain's fit with what nuisances do where it has come to."""
        self._say(f"replaying what is ordinary beside {gain.name}")
        with self.model.following():
            fit = self.refined(gain.fit)
        return self.replayed(fit)

    def _beyond(self, now: RobotFit) -> dict[str, float]:
        """Knobs of effects that stand for tolerances at their ends, twice as far as those go.

        By traces and curves they would begin where there are no such tolerances, and go astray.
        """
        model = self.model
        far = stretched(model.nuisances, now.nuisances)
        found = {}
        for nuisance, z in zip(model.nuisances, now.nuisances.tolist(), strict=True):
            for name in far.intersection(nuisance.same):
                knob = knob_of(model.base, model.placed[name], nuisance, 2.0 * z)
                if knob is not None:
                    found[name] = knob
        return found

    def _best(self, gains: Sequence[RobotGain], now: RobotFit, begun: float) -> RobotGain | None:
        """The best that holds, of those first that make no whole recording much worse.

        What is half of the truth may do that, and is taken until the rest is found as well.
        """
        held = [gain for gain in gains if self._holds(gain, now)]
        stand = [gain for gain in held if self._whole_square(gain.fit) <= WORSE * begun]
        return max(stand or held, key=lambda gain: gain.deflated, default=None)

    def _with(
        self, gain: RobotGain, now: RobotFit, exact: RobotFit, plain: float | None
    ) -> RobotGain:
        """A gain by exact replays; ``plain`` is what left-out recordings make of ``now``."""
        outside = None if plain is None else plain - (self._left_out(exact) or 0.0)
        return replace(gain, fit=exact, nats=now.cost - exact.cost, held_out=outside)

    def _from_far(self, found: RobotFit) -> RobotFit:
        """An exact fit, or that from a large try of its last effect, if that is deeper.

        A spring has two valleys: a little of it, which tolerances of a stiff robot help, and much.
        """
        best = found
        _, *large = self.model.curves.tries(found.names[-1])
        for z in large:
            if found.z[-1] > 0.5 * z:
                continue
            with self.model.following():
                there = self.begun(found.names, np.append(found.knobs[:-1], z), found.noise)
            best = min(best, self.replayed(there), key=lambda fit: fit.cost)
        return best

    def _whole_square(self, found: RobotFit) -> float:
        """Mean square [rad^2] of a whole recording, standing up as well, which no fit has seen."""
        model = self.model
        added = of_settings(model.placed, found.settings, "fitted")
        return rmse_rad(judge(model, model.robot, found.nuisances, added, self.which[:1])) ** 2

    def screen(self, now: RobotFit) -> Screen:
        """A screening of what a fit leaves, on the recordings of one motion: fits take them all."""
        motion = self.model.motion
        some = [r for r in self.which if motion[r] == motion[self.which[0]]]
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

    def _worth_looking(self, screen: Screen) -> list[str]:
        """All that is everywhere or of a kind, and places in legs that stand out."""
        legs = {leg.name for leg in self.model.base.legs}
        joints = {joint.name for joint in self.model.base.joints}
        worst = set(screen.standing_out())
        names = []
        for name in self.model.placed:
            place = name.partition("@")[2]
            leg = leg_of(place, legs)
            if not leg or (leg in worst and (place in worst or place not in joints)):
                names.append(name)
        return names

    def _step(self, some: Sequence[Screened], now: RobotFit, step: int) -> list[RobotGain]:
        """Fits of effects by traces and curves, as believed but for the effects that are taken."""
        nothing = np.zeros(len(self.model.nuisances))
        self.model.retrace(now.settings, nothing)
        self.model.recentre(now.settings, nothing, self.which)
        plain = self.fitted(now.names, np.append(nothing, now.knobs), now.noise)
        gains: list[RobotGain] = []
        for one in some:
            self._say(f"step {step + 1}: fitting {one.name}")
            gains.append(self._confirm(plain, one))
        return levelled(gains)

    def _confirm(self, now: RobotFit, one: Screened) -> RobotGain:
        placed, sight = self.model.placed[one.name], self.sight
        names = (*now.names, one.name)
        low, high = placed.knob.bounds
        first = self.model.curves.first_z(one.name)
        starts = {float(np.clip(side * first * x, low, high)) for x in TRIED for side in (-1, 1)}
        box = sight.box(names)
        wanted = sorted({*starts, one.z} - {0.0})
        vectors = [np.clip(np.append(now.z, z), *box) for z in wanted]
        costs = [sight.cost(sight.blocks(names, z), now.noise) for z in vectors]
        fitted = self.fitted(names, vectors[int(np.argmin(costs))], now.noise)
        wide = sight.inflation(fitted, one.name)
        return RobotGain(one.name, fitted, now.cost - fitted.cost, wide, None)

    def _left_out(self, found: RobotFit) -> float | None:
        """What groups cost that are left out in turn [nats], fitted anew without them.

        ``None`` where all recordings are of one group.
        """
        groups: dict[str, list[int]] = {}
        for r in self.which:
            groups.setdefault(self.model.observed[r].group, []).append(r)
        if len(groups) < 2:
            return None
        self.model.recentre(found.settings, found.nuisances, self.which)
        total, sight = 0.0, self.sight
        for part in groups.values():
            rest = [r for r in self.which if r not in part]
            again = sight.fit(found.names, found.z, found.noise, rest, rounds=1)
            total += sight.cost(sight.blocks(found.names, again.z, part), found.noise)
        return total

    @staticmethod
    def _holds(gain: RobotGain, now: RobotFit) -> bool:
        if gain.deflated < (BESIDE if now.names else NEEDED):
            return False
        outside = gain.held_out
        if outside is None or outside / gain.inflation > HELD_OUT:
            return True
        return outside > -gain.apart and gain.deflated >= BESIDE

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
                wide = self.sight.inflation(now, gain.name)
                losses.append(((without.cost - now.cost) / wide, gain, without))
            loss, gain, without = min(losses, key=lambda entry: entry[0])
            if loss >= NEEDED:
                break
            now, taken = without, [g for g in taken if g is not gain]
        return now, taken

    def _standing(
        self, base: RobotFit, now: RobotFit, taken: list[RobotGain]
    ) -> tuple[RobotFit, list[RobotGain]]:
        """Effects that together make no whole recording much worse; the last go first."""
        begun = self._whole_square(base) if taken else 0.0
        while taken and self._whole_square(now) > WORSE * begun:
            *taken, last = taken
            now = self.settle(self.sight.without(now, last.name)) if taken else base
        return now, taken
