"""One step of a search on legs: effects at places are fitted beside what is taken, and one holds.

An effect is taken when it gains enough on what it is fitted to and, where there are several groups
of recordings, on those left out. Where tolerances had paid for it, it gains that they need not, and
nothing on those: it must gain more then, and lose no more there than fits of one hypothesis end
apart by. What loads show by themselves asks no group: along the recorded angles no tolerance of
another one plays a part. Then exactly that robot is replayed.

Every hypothesis begins as believed but for its effects: where tolerances have paid for what is the
matter, no small step leads back from. Its rivals are fitted again from where the best of them has
led, and so is what it is held against, as what begins elsewhere may end deeper by itself.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np

from ..joint.nuisances import LATE_S
from .effects import ONE_WITH
from .exact import ExactFits
from .features import MEANS, RobotKind
from .fit import ENOUGH, RobotFit
from .gains import HOPELESS, NEEDED, RobotGain, levelled
from .improved import knob_of, of_settings
from .judging import judge, rmse_rad
from .model import Progress, RobotModel
from .screen import Screened, stretched

#: gain [nats, deflated] of an effect beside others, as it may take up what those leave unexplained,
#: and of one that gains nothing on groups of recordings left out
BESIDE = 15.0
HELD_OUT = 1.5  #: gain [nats, deflated] on groups of recordings left out, of one that gains less
LEFT_OUT = "groups of recordings that were left out in turn are no better with it"
WORSE = 1.5  #: times the mean square of a whole recording that no effect may make of it,
#: or times that of this [rad], if that is more: how a robot stands up is chance. Nulls of another
#: engine left 1.9 to 3.2 mrad of whole recordings, and robots with a name that is true 2.2 to 3.7
SOUND_RAD = 0.0032
PROMISED = 3  #: effects of a step that are tried, beside those for a tolerance at its end
#: promise [nats] from which they are. What is called noise before anything is named has what is
#: the matter in it: a limit of one leg's speed promised 6.9 and gained 497. Assumed
HINTED = 2.0
BEST = 4  #: of them that are fitted to the end: begun is not half of it where tolerances hide one
#: nats behind the best try of a step within which others are gone on with: rivals are nearer than
#: 20 and four times an inflation of up to 5, and the best few are fitted to the end. Assumed
RIVALS = 60.0
LESS = 0.6  #: of what is taken, from which what stands beside it begins as well; assumed
TRIED = (0.3, 1.0, 3.0, 8.0)  #: in first tries, where fits start
BEHIND = "not fitted to the end: others were ahead"


def much_worse(square: float, begun: float) -> bool:
    """Whether that of a whole recording [rad^2] is much more than it was, and than chance makes."""
    return square > WORSE * max(begun, SOUND_RAD**2)


class Steps(ExactFits):
    """Steps of a search on some recordings of a model, with some kinds of channels."""

    def __init__(
        self,
        model: RobotModel,
        which: Sequence[int] | None = None,
        kinds: Iterable[RobotKind] = MEANS,
        say: Progress = lambda _: None,
    ) -> None:
        super().__init__(model, which, kinds)
        self._say = say

    def _chosen(
        self, now: RobotFit, promised: Sequence[RobotGain], named: Collection[str]
    ) -> tuple[RobotGain | None, RobotFit, tuple[RobotGain, ...]]:
        """The gain that holds best, if one does; what it gains over; all that was tried.

        The others are fitted again from where the best of them has led, and so is what it gains
        over. The best is first.
        """
        tried = self._tried(now, promised, named)
        self.around(now)  # what is left out is asked where it is known what all does
        plain, begun = self._left_out(now), self._whole_square(now)
        ahead = [g for g in tried[:BEST] if g.fit.cost <= tried[0].fit.cost + HOPELESS]
        few = [self._with(gain, now, self._further(gain), plain) for gain in ahead]
        chosen = self._best(few, now, begun)
        if chosen is not None:
            self._say(f"replaying much of {chosen.name}")
            far = self._with(chosen, now, self._from_far(chosen.fit), plain)
            if far.nats > chosen.nats + ENOUGH and self._best([chosen, far], now, begun) is far:
                few[few.index(chosen)] = chosen = far
            at = chosen
            few = [one if one is at else self._from_there(one, at, now, plain) for one in few]
            chosen = self._best(few, now, begun)
        asked: set[str] = set()
        while chosen is not None and chosen.name not in asked:
            asked.add(chosen.name)
            self._say(f"asking what is ordinary to do without {chosen.name}")
            nuisances = chosen.fit.nuisances
            most = now.cost + HOPELESS
            again = self.thoroughly(now.names, now.knobs, now.noise, nuisances, most)
            if again.cost > now.cost - ENOUGH:
                break
            left = self._left_out(again)
            few = [self._over(gain, now, again, plain, left) for gain in few]
            now, plain = again, left
            chosen = self._best(few, now, self._whole_square(now))
        few = [one if one is chosen else self._passed_over(one, now) for one in few]
        behind = [few[0].nats + tried[0].fit.cost - gain.fit.cost for gain in tried[len(few) :]]
        rest = [
            replace(g, nats=nats, because=BEHIND)
            for g, nats in zip(tried[len(few) :], behind, strict=True)
        ]
        self.around(now if chosen is None else chosen.fit)
        return chosen, now, tuple(sorted([*few, *rest], key=lambda gain: -gain.deflated))

    def _tried(
        self, now: RobotFit, promised: Sequence[RobotGain], named: Collection[str]
    ) -> list[RobotGain]:
        """What promises most, and what stands for a tolerance at its end (``named``); best first.

        Fits begin as believed but for what is taken, and with what nuisances do there: promises are
        wrong by more than what they are of. What is promised twice is begun twice, and so is what
        stands beside another that is not held, which may have its part. What falls far behind is
        not gone on with.
        """
        beyond = self._beyond(now)
        most = self._most(promised)
        tried: list[RobotGain] = []
        shares = (1.0, LESS) if set(now.names) - set(self.sight.held) else (1.0,)
        for gain in promised:
            if gain.name in named or gain in most:
                self._say(f"trying {gain.name}")
                last = beyond.get(gain.name, gain.fit.knobs[-1])
                for share in shares:
                    knobs = np.append(share * now.knobs, last)
                    with self.model.following():
                        best = min((one.fit.cost for one in tried), default=math.inf)
                        fit = self.begun(gain.fit.names, knobs, now.noise, most=best + RIVALS)
                    tried.append(replace(gain, fit=fit))
        better = {gain.name: gain for gain in sorted(tried, key=lambda gain: -gain.fit.cost)}
        return sorted(better.values(), key=lambda gain: gain.fit.cost)

    @staticmethod
    def _most(promised: Sequence[RobotGain]) -> list[RobotGain]:
        """The few that promise most, of those that promise anything."""
        most = sorted(promised, key=lambda gain: -gain.nats)[:PROMISED]
        return [gain for gain in most if gain.nats >= HINTED]

    def _further(self, gain: RobotGain) -> RobotFit:
        """A gain's fit with what nuisances do where it has come to."""
        self._say(f"replaying what is ordinary beside {gain.name}")
        with self.model.following():
            fit = self.refined(gain.fit)
        return self.replayed(fit)

    def _from_there(
        self, gain: RobotGain, best: RobotGain, now: RobotFit, plain: float | None
    ) -> RobotGain:
        """A gain as it is, or from where the best of its step has led, if that is deeper."""
        self._say(f"trying {gain.name} from where {best.name} has led")
        most = min(gain.fit.cost, best.fit.cost + gain.apart)
        names, knobs = gain.fit.names, gain.fit.knobs
        fit = self.thoroughly(names, knobs, now.noise, best.fit.nuisances, most)
        return self._with(gain, now, fit, plain) if fit.cost < most else gain

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

        What is half of the truth may do that, and is taken until the rest is found as well. Of two
        that are one with each other the likelier is taken, where the other is not ahead.
        """
        held = [gain for gain in gains if self._holds(gain, now)]
        stand = [gain for gain in held if not much_worse(self._whole_square(gain.fit), begun)]
        best = max(stand or held, key=lambda gain: gain.deflated, default=None)
        if best is None:
            return None
        likelier = (g for g in stand or held if g.name == ONE_WITH.get(best.name))
        return next((g for g in likelier if best.ahead_of(g) == 0.0), best)

    def _with(
        self, gain: RobotGain, now: RobotFit, exact: RobotFit, plain: float | None
    ) -> RobotGain:
        """A gain by exact replays; ``plain`` is what left-out recordings make of ``now``."""
        outside = None if plain is None else plain - (self._left_out(exact) or 0.0)
        return replace(gain, fit=exact, nats=now.cost - exact.cost, held_out=outside)

    @staticmethod
    def _over(
        gain: RobotGain, before: RobotFit, now: RobotFit, plain: float | None, again: float | None
    ) -> RobotGain:
        """A gain over another fit without it; ``plain`` and ``again``: on groups left out."""
        outside = gain.held_out
        if outside is not None and plain is not None and again is not None:
            outside += again - plain
        return replace(gain, nats=gain.nats + now.cost - before.cost, held_out=outside)

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
                knobs, most = np.append(found.knobs[:-1], z), best.cost + HOPELESS
                there = self.begun(found.names, knobs, found.noise, most=most)
            if there.cost <= most:
                best = min(best, self.replayed(there), key=lambda fit: fit.cost)
        return best

    def _whole_square(self, found: RobotFit) -> float:
        """Mean square [rad^2] of a whole recording, standing up as well, which no fit has seen."""
        model = self.model
        added = of_settings(model.placed, found.settings, "fitted")
        return rmse_rad(judge(model, model.robot, found.nuisances, added, self.which[:1])) ** 2

    def _step(self, some: Sequence[Screened], now: RobotFit, step: int) -> list[RobotGain]:
        """Fits of effects by traces and curves, as believed but for the effects that are taken."""
        if not some:
            return []
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

    def _within_ticks(self, gain: RobotGain) -> bool:
        """Whether it is a time of less than a firmware's ticks may make, which nobody knows."""
        placed = self.model.placed[gain.name]
        knob = gain.fit.knobs[gain.fit.names.index(gain.name)]
        return placed.parameter.unit == "s" and abs(placed.knob.value(float(knob))) < LATE_S

    def _holds(self, gain: RobotGain, now: RobotFit) -> bool:
        return not self._denied(gain, now)

    def _denied(self, gain: RobotGain, now: RobotFit) -> str:
        """Why a gain is not enough for a name; nothing where it is."""
        counts, needed = gain.counting(now), BESIDE if now.names else NEEDED
        if self._within_ticks(gain):
            return "no more than the ticks of a firmware may make"
        if counts < needed:
            beside = " beside what is named" if now.names else ""
            return f"less than the {needed:.0f} nats that a name needs{beside}"
        outside = gain.held_out
        shown = now.once - gain.fit.once >= BESIDE  # by registers
        if shown or outside is None or outside / gain.inflation > HELD_OUT:
            return ""
        if outside > -gain.apart and counts >= BESIDE:
            return ""
        return LEFT_OUT

    def _passed_over(self, gain: RobotGain, now: RobotFit) -> RobotGain:
        """A gain that is not taken, with why."""
        return replace(gain, because=self._denied(gain, now) or "another one did better")
