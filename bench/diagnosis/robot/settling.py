"""Which names of a whole robot hold: what a search found, on recordings that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from busemu.tables import Robot

from ..joint.growing import RELIEF
from ..joint.rivals import CLOSE
from .causes import chance_of, number_of
from .denials import Denials
from .features import RobotKind
from .fit import FIRM, REGISTERS, RobotFit
from .gains import RobotFindings, RobotGain
from .improved import of_settings, tolerated
from .judging import floor_rad, judge, rmse_rad, steady_rmse_rad
from .model import Progress, is_play
from .nuisances import RobotNuisance
from .rest import Rest, rest_of
from .search import AT_END
from .sizes import BETWEEN, best_size
from .steps import BESIDE, LEFT_OUT, WORSE, much_worse

#: mean squares over those of noise up to which robots are as believed, where tolerances were
#: fitted and elsewhere; ten nulls of another engine had 0.20 to 0.56, and 0.40 to 1.65
FITTED, JUDGED = 0.6, 1.8
FAR = 3.0  #: times that from which no tolerances are looked for that leave less; assumed
#: RMS of walked samples over that of a sound model, up to which recordings that judge are as
#: believed; ten nulls of the other engine had 1.0 to 1.4
SAMPLES = 1.6
#: the same where robots stand, of noise with what is chance in it: six nulls of other engines had
#: 0.1 to 0.8, two Marvins of the engine of proofs 0.5, and two PhantomXs 1.6
STANDING = 2.0
ENDS = 1  #: so many of the robot's tolerances may be at their ends; nulls had 0 or 1, few 2, one 3
LITTLE = 0.1  #: share of the misfit above the floor that a name must take away where it is judged
#: the same of all names together, of samples, where those are far off with them: of 60 opened
#: answers six of seven that took less were wrong, and all that are wholly right took 0.56 and more
PART = 0.5
FALLEN = 30.0  #: floors of misfit beyond which a robot stands or lies otherwise; assumed
#: probability by likelihoods below which names are not said: of three that were, one is true
UNLIKELY = 0.25
ORDINARY = "its size may be no more than what is ordinary, and nothing else is left to explain"
FAINT = f"less than the {BESIDE:.0f} nats that a name needs where nothing else is left to explain"
FARTHER = "its number is as far as it may be, and would go farther: it stands for something else"
NO_PART = "all names together leave most of what recordings that were not used to fit are off by"
NO_BETTER = "recordings that were not used to fit are no better with it"
UNSURE = "too unlikely beside what follows the recordings as well, or what no catalogue has"


def far_off(rms_rad: float, floor_rad: float) -> bool:
    """Whether walked samples are farther off than those of a sound model may be."""
    return rms_rad > SAMPLES * floor_rad


def leaves_most(before: float, left: float, floor_rad: float) -> bool:
    """Whether samples are far off, by more than half of what they were (mean squares, rad^2)."""
    off = before - floor_rad**2
    return far_off(left**0.5, floor_rad) and before - left < PART * off


@dataclass(frozen=True, slots=True)
class Squares:
    """Mean squares of samples [rad^2]: of the steady part of recordings, and of all of them."""

    steady: float
    whole: float


@dataclass(frozen=True, slots=True, eq=False)
class RobotJudges(Denials):
    """Recordings that judge a search: those that were held out, or else those that it is fitted to.

    ``which`` and ``judges`` are numbers of recordings.
    """

    robot: Robot
    held_out: bool

    def square(self, found: RobotFit, which: Sequence[int]) -> float:
        """Mean square of phase means that a fit leaves by exact replays [rad^2]."""
        self.model.recentre(found.settings, found.nuisances, which)
        blocks = self.model.residuals(found.names, found.z, which)
        rows = [b.value for (_, kind), b in blocks.items() if kind is RobotKind.JOINTS]
        return float(np.mean(np.concatenate(rows) ** 2))

    def consistent(self, base: RobotFit) -> bool:
        """Whether what the operator believes leaves no more than noise.

        Of recordings that it was fitted to tolerances take much away; on others they cannot. Nor is
        a robot as believed of which several tolerances have gone to their ends: something is the
        matter for which they stand in. Nor one whose servos show another voltage, or one joint of
        which is off by itself: the mean over all hides that. Nor one whose samples are far off:
        what differs from turn to turn counts as noise of the means.
        """
        return len(self.at_ends(base)) <= ENDS and self.quiet(base)

    def far(self, found: RobotFit) -> bool:
        """Whether a fit is far from leaving no more than noise."""
        return self.over_noise(found, self.which) > FAR * FITTED

    def quiet(self, base: RobotFit) -> bool:
        """Whether no more than noise is left, wherever tolerances have gone for that."""
        return not self.volts_denied(base) and not self.duties_denied(base) and self.placid(base)

    def placid(self, base: RobotFit) -> bool:
        """Whether no more than noise is left of positions, whatever registers show."""
        fitted = self.over_noise(base, self.which) < (STANDING if self.stands else FITTED)
        judged = not self.held_out or self.over_noise(base, self.judges) < JUDGED
        return fitted and judged and not self.rest(base).local and not self.unlike(base)

    @property
    def stands(self) -> bool:
        """Whether robots stand in some recordings: fits follow what is chance there."""
        return any(self.model.features[r].phase is None for r in self.which)

    def unlike(self, found: RobotFit) -> bool:
        """Whether walked samples of recordings that judge are farther off than noise."""
        return far_off(self.samples(found).steady ** 0.5, self.sound_rad)

    @property
    def sound_rad(self) -> float:
        """RMS of walked samples that a sound model leaves where it is judged [rad]."""
        return floor_rad(self.model, self.judges)

    def rest(self, found: RobotFit) -> Rest:
        """What a fit leaves where it is judged, by exact replays."""
        every = sorted({*self.which, *self.judges})
        self.model.recentre(found.settings, found.nuisances, every)
        return rest_of(self.model, found, self.which, self.judges)

    def explainable(self, base: RobotFit, now: RobotFit) -> float:
        """How much of the misfit where it is judged can be explained [rad^2]; 0 or less: nothing.

        All above the floor, or what a fit that goes below that has taken away: several names each
        have their own part of it then.
        """
        before, floor = self.square(base, self.judges), self.floor_square
        return before - (min(floor, self.square(now, self.judges)) if before > floor else floor)

    def explained(self, without: RobotFit, now: RobotFit, explainable: float) -> float:
        """Share of the misfit where it is judged that a name takes away, -1 to 1.

        ``explainable`` [rad^2] is of positions, as :meth:`explainable` has it. Where tolerances
        leave none of that, or take it about as well, a name shows in registers, if anywhere.
        """
        off = self.square(without, self.judges) - self.square(now, self.judges)
        seen = abs(off) >= LITTLE * explainable or not self.restores(without, now)
        if explainable > 0.0 and seen:
            return float(np.clip(off / explainable, -1.0, 1.0))
        shows = self.duties_off if self.duties_denied(without) else self.volts_more
        left, more = (shows(fit) ** 2 for fit in (now, without))
        return float(np.clip(1.0 - left / more, -1.0, 1.0)) if more else 0.0

    def undenied(self, found: RobotFindings) -> RobotFindings:
        """Findings without those rivals that registers speak against, where less against the name.

        Means over the phase may follow a low gain as well as a low supply, and a likelihood with
        heavy tails lets one channel be far off. Only rivals beside the same names are asked.
        """
        tried, alike = list(found.tried), dict(found.alike)
        for gain in found.taken:
            k = next((k for k, step in enumerate(tried) if any(g is gain for g in step)), None)
            if k is None:
                continue
            close = [g for g in tried[k] if g is not gain and gain.ahead_of(g) < CLOSE]
            beside = {g.name: set(g.fit.names) - {g.name} for g in (gain, *close)}
            close = [g for g in close if beside[g.name] == beside[gain.name]]
            denied = {g.name for g in close if self.restores(g.fit, gain.fit)}
            tried[k] = tuple(g for g in tried[k] if g.name not in denied)
            alike[gain.name] = tuple(p for p in alike.get(gain.name, ()) if p[0] not in denied)
        return replace(found, tried=tuple(tried), alike=alike)

    def strained(self, found: RobotFit, let_go: Collection[str] = ()) -> tuple[str, ...]:
        """Tolerances at their ends, if they stand in for something that has no name.

        That takes more of them than where nothing is the matter, and all of the whole robot's
        together farther off than their priors have it: fits draw them towards what is believed.
        One that gains nothing where it may go farther, as an effect that was fitted to the end
        (``let_go``), is not pushed there.
        """
        at_ends = self.at_ends(found)
        names = [n.name for n in at_ends if not set(let_go).intersection(n.same)]
        pairs = zip(self.model.nuisances, found.nuisances.tolist(), strict=True)
        squares = [z**2 for n, z in pairs if n.common]
        return tuple(names) if len(names) > ENDS and sum(squares) > len(squares) else ()

    def at_ends(self, found: RobotFit) -> list[RobotNuisance]:
        """Tolerances of the whole robot that a fit has taken as far as they may go.

        Where robots stand, chance does so, and none of them tells anything.
        """
        if self.stands:
            return []
        pairs = zip(self.model.nuisances, found.nuisances.tolist(), strict=True)
        return [n for n, z in pairs if n.common and n.far(z, AT_END)]

    def over_noise(self, found: RobotFit, which: Sequence[int]) -> float:
        """Mean square that a fit leaves over that of noise: engines, rounding, scatter of turns.

        Where robots stand that of what is left, or of how it changes, whichever is more.
        """
        self.model.recentre(found.settings, found.nuisances, which)
        joints = RobotKind.JOINTS
        floor = self.model.floors()[joints] ** 2
        blocks = self.model.residuals(found.names, found.z, which)
        own = [block for (_, kind), block in blocks.items() if kind is joints]
        whole = [b.value**2 / (floor + b.scatter) for b in own]
        apart = [b.apart() ** 2 / (floor + b.extra) for b in own]
        return max(float(np.mean(np.concatenate(ratio))) for ratio in (whole, apart))

    def outside(self, found: RobotFit, firm: float = 1.0) -> float:
        """What a fit costs on recordings that judge [nats], all but registers divided."""
        self.model.recentre(found.settings, found.nuisances, self.judges)
        sight = self.search.sight
        blocks = sight.blocks(found.names, found.z, self.judges)
        once = sight.cost({k: b for k, b in blocks.items() if k[1] in REGISTERS}, found.noise)
        return (sight.cost(blocks, found.noise) - once) / firm + once

    @property
    def floor_square(self) -> float:
        """Mean square of phase means that a sound model leaves where it is judged [rad^2]."""
        extra = [
            float(np.mean(self.model.spread[self.model.motion[r]][RobotKind.JOINTS]))
            for r in self.judges
        ]
        return float(self.model.floors()[RobotKind.JOINTS] ** 2 + np.mean(extra))

    def kept(
        self,
        found: RobotFindings,
        say: Progress,
        risen: Callable[[RobotFit], bool] = lambda _: False,
    ) -> tuple[list[RobotGain], RobotFit, list[Mapping[str, Any]]]:
        """Names that recordings which judge do not deny; the fit with them; those taken back.

        All together may not make whole recordings, standing up and all, half as bad again, unless
        how the robot stands up has a name of its own beside them (``risen`` asks of a fit), and
        must take half of what is far off: if not, those go that no register asks for (but beside
        play: samples rattle then). Before one is taken back it is asked for at other sizes, as far
        as two engines differ about it; next to falling all are. None may be as far as it may go: of
        95 names of opened proofs that was one, not true. Of a robot that is consistent but for
        registers that do not ask for it, it must gain as much as beside another (in six nulls of
        another engine the best gained 6 nats, deflated).
        """
        taken, now = list(found.taken), found.fit
        rejected: list[Mapping[str, Any]] = []
        quiet = bool(taken) and self.quiet(found.base)
        calm = bool(taken) and len(self.at_ends(found.base)) <= ENDS and self.placid(found.base)
        for gain in found.taken:
            if because := self._refused(found, now, gain, calm=calm, quiet=quiet):
                now = self.without(found.base, now, gain.name)
                taken = [other for other in taken if other is not gain]
                rejected.append(self._taken_back(gain, because))
        begun = self.samples(found.base) if self.held_out and taken else Squares(0.0, 0.0)
        resized: set[str] = set()
        while taken and self.held_out:
            say("asking recordings that were not used to fit")
            floor, before = self.floor_square, self.square(found.base, self.judges)
            least = max(RELIEF * floor, LITTLE * min(before - floor, FALLEN * floor))
            fits = {gain.name: self.without(found.base, now, gain.name) for gain in taken}
            seen = self.samples(now)
            spare = {name: self._spare(fit, now, seen, least) for name, fit in fits.items()}
            worst = min(taken, key=lambda gain: spare[gain.name])
            if spare[worst.name] > 0.0 and (not much_worse(seen.whole, begun.whole) or risen(now)):
                idle = self._no_part(now, fits, begun.steady, seen.steady)
                if not idle or any(map(is_play, found.base.names)):
                    break
                for gain in [gain for gain in taken if gain.name in idle]:
                    now = self.without(found.base, now, gain.name)
                    taken = [other for other in taken if other is not gain]
                    rejected.append(self._taken_back(gain, NO_PART))
                continue
            others = [gain.name for gain in taken] if self.fallen(now) else []
            asked = [n for n in dict.fromkeys((worst.name, *others)) if n not in resized]
            sized = {name: self.resized(now, name) for name in asked}
            better = [name for name, fit in sized.items() if fit is not now]
            if better:
                name = min(better, key=lambda name: self.square(sized[name], self.judges))
                resized.add(name)
                now = sized[name]
                continue
            rejected.append(self._taken_back(worst, NO_BETTER))
            now = fits[worst.name]
            taken = [gain for gain in taken if gain is not worst]
        return taken, now, rejected

    def _no_part(
        self, now: RobotFit, without: Mapping[str, RobotFit], before: float, left: float
    ) -> list[str]:
        """Names, no register asking for them, of those that leave half of what samples are off by.

        None where what is left is not far over noise, or little decides how a robot lies.
        ``without`` has the fit without each.
        """
        if not leaves_most(before, left, self.sound_rad) or self.fallen(now):
            return []
        return [name for name, fit in without.items() if not self.restores(fit, now)]

    def _taken_back(self, gain: RobotGain, because: str) -> Mapping[str, Any]:
        """A name that does not hold, as ``diagnosis.json`` has it."""
        return {
            "effect": self.model.placed[gain.name].effect.name,
            "scope": list(self.model.placed[gain.name].where),
            "gain_nats": float(gain.deflated),
            "because": because,
        }

    def _refused(
        self, found: RobotFindings, now: RobotFit, gain: RobotGain, *, calm: bool, quiet: bool
    ) -> str:
        """Why a name does not hold whatever recordings say that judge; nothing if it may.

        One that no register asks for must gain as much as beside another where positions are
        ``calm``, must gain on groups left out, and must be likelier than all else. Where no more
        than noise is left without any (``quiet``), it must be more than a tolerance has, or gain
        much and free several of them from their ends: together that is more than they have.
        """
        base = found.base
        if number_of(self.search, now, gain.name).state == "at bound":
            return FARTHER
        if (weak := self._weak(found, gain, calm)) and not self.restores(
            self.without(base, now, gain.name), now
        ):
            return weak
        if not quiet or not self.ordinary(now, gain.name):
            return ""
        frees = gain.counting(base) >= BESIDE and self.strained(base) and not self.strained(now)
        return "" if frees else ORDINARY

    def _weak(self, found: RobotFindings, gain: RobotGain, calm: bool) -> str:
        """Why a name is not enough by its gains and its rivals'; nothing if it is."""
        if calm and gain.counting(found.base) < BESIDE:
            return FAINT
        if gain.held_out is not None and gain.held_out <= 0.0:
            return LEFT_OUT
        return UNSURE if chance_of(self.model, self.undenied(found), gain) < UNLIKELY else ""

    def ordinary(self, now: RobotFit, name: str) -> bool:
        """Whether a name may be no more than a tolerance has it, by its interval."""
        model = self.model
        ends = tolerated(model.base, model.placed[name], model.nuisances)
        if not ends:
            return False
        low, high = number_of(self.search, now, name).ci95
        return low <= ends[1] and high >= ends[0]

    def _spare(self, without: RobotFit, now: RobotFit, seen: Squares, least: float) -> float:
        """How much more than it must a name takes off the square that judges see [rad^2].

        It must take off ``least``, and make samples (``seen`` with it) better. Where without it
        tolerances stand in for something, and with it none do, those had foretold recordings that
        judge as well: it may be worse there by that much. So where without it registers deny the
        model, and it takes away most of that: samples may be worse, too. But not beside another
        name: that may be what they stand in for. Where loads deny the model without it, and with it
        no more than noise is left of anything, it takes off enough.
        """
        if self.duties_denied(without) and self.quiet(now):
            return np.inf
        restores = self.restores(without, now)
        frees = restores or (bool(self.strained(without)) and not self.strained(now))
        if frees and len(now.names) > 1:
            frees = self.outside(now, FIRM) < self.outside(without, FIRM)
        worse = WORSE if frees and restores else 1.0
        if seen.steady >= worse * self.samples(without).steady:
            return -np.inf
        off = self.square(without, self.judges) - self.square(now, self.judges)
        return off + least if frees else off - least

    def fallen(self, found: RobotFit) -> bool:
        """Whether a fit stands or lies otherwise where it is judged, as if next to falling."""
        return self.square(found, self.judges) > FALLEN * self.floor_square

    def resized(self, now: RobotFit, name: str) -> RobotFit:
        """A fit with the size of one effect that recordings which judge like best, or itself.

        They are of other loads, where a robot may be next to falling and a little decides.
        """
        steps = BETWEEN if self.fallen(now) else ()
        best, _ = best_size(self.search, now, name, partial(self.square, which=self.judges), steps)
        return best if best is now else self.search.replayed(best)

    def samples(self, found: RobotFit) -> Squares:
        """What a fit leaves of the samples of recordings that judge."""
        added = of_settings(self.model.placed, found.settings, "fitted")
        judged = judge(self.model, self.robot, found.nuisances, added, self.judges)
        walking = steady_rmse_rad([self.model.features[r] for r in self.judges], judged)
        return Squares(walking**2, rmse_rad(judged) ** 2)

    def without(self, base: RobotFit, now: RobotFit, name: str) -> RobotFit:
        """The fit without one effect, its replays as exact as those with it."""
        if set(now.names) == {*base.names, name}:
            return base
        return self.search.settle(self.search.sight.without(now, name))
