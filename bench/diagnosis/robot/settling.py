"""Which names of a whole robot hold: what a search found, on recordings that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..joint.growing import RELIEF
from ..result import part_beside
from .causes import chance_of, close_rivals, number_of
from .fit import FIRM, RobotFit
from .gains import RobotFindings, RobotGain
from .improved import tolerated
from .judges import ENDS, FALLEN, LITTLE, Judges, Squares, leaves_most
from .model import Progress, is_play
from .steps import BESIDE, LEFT_OUT, WORSE, much_worse

#: probability by likelihoods below which names are not said: of three that were, one is true
UNLIKELY = 0.25
#: the same beside a rest that has no name: of the 173 names of runs 23 to 46 one was less likely
#: where no register asked for it, not true (0.055)
SCARCELY = 0.1
ORDINARY = "its size may be no more than what is ordinary, and nothing else is left to explain"
FAINT = f"less than the {BESIDE:.0f} nats that a name needs where nothing else is left to explain"
STANDS_IN = "tolerances of its own joints are, together, off more than they are by chance"
DRIVEN = (
    "tolerances of gain and torques are, together and one way, off more than they are by chance"
)
FARTHER = "its number is as far as it may be, and would go farther: it stands for something else"
#: share of the square of means above the floor that names with play among them must take: play
#: that is true took 0.48 and 0.71 of it (0.35 and 0.33 of samples), for springs it took 0.27
PLAYED = 0.4
OTHER_VOLTS = "servos show another voltage than with it, and how they move follows from that, too"
AS_WELL = "a number that files only assume, no more off than such a number is, does as well"
ASSUMED = "its number is assumed, and may be no more off than such a number is"
NO_SIZE = "it may be of no size: its interval holds that at which the model is as without it"
NO_PART = "all names together leave most of what recordings that were not used to fit are off by"
NO_BETTER = "recordings that were not used to fit are no better with it"
UNSURE = "too unlikely beside what follows the recordings as well, or what no catalogue has"
#: reasons after which no other name is looked for: what follows recordings next to that one would
#: stand in for the same, or be as likely
LAST = frozenset({UNSURE, STANDS_IN, DRIVEN, OTHER_VOLTS, ASSUMED, AS_WELL})


class Named(NamedTuple):
    """What a search found, the names that hold, the fit with them, and those taken back."""

    found: RobotFindings
    taken: list[RobotGain]
    after: RobotFit
    rejected: list[Mapping[str, Any]]


@dataclass(frozen=True, slots=True, eq=False)
class RobotJudges(Judges):
    """What recordings that judge make of the names that a search found."""

    def kept(
        self,
        found: RobotFindings,
        say: Progress,
        risen: Callable[[RobotFit], bool] = lambda _: False,
    ) -> Named:
        """Names that recordings which judge do not deny; the fit with them; those taken back.

        All together may not make whole recordings, standing up and all, half as bad again, unless
        how the robot stands up has a name of its own beside them (``risen`` asks of a fit), and
        must take half of what samples are far off (beside play those rattle: a part of what means
        are): if not, those go that no register asks for. Before one is taken back it is asked for
        at other sizes, as far as two engines differ about it; next to falling all are. None may be
        as far as it may go: of 95 names of opened proofs that was one, not true. Of a robot that is
        consistent but for registers that do not ask for it, it must gain as much as beside another
        (in six nulls of another engine the best gained 6 nats, deflated).
        """
        taken, now, rejected = self._firm(found)
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
                if not idle or self._plays(found.base, now, before):
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
        for gain in self._scarce(found, taken, now):
            now = self.without(found.base, now, gain.name)
            taken = [other for other in taken if other is not gain]
            rejected.append(self._taken_back(gain, UNSURE))
        return Named(found, taken, now, rejected)

    def _scarce(
        self, found: RobotFindings, taken: Sequence[RobotGain], now: RobotFit
    ) -> list[RobotGain]:
        """Names for which next to nothing speaks beside a rest that may make their part as well."""
        if not taken:
            return []
        foretold, explainable = self.rest(now).foretold, self.explainable(found.base, now)
        undenied, scarce = self.undenied(found), []
        for gain in taken:
            without = self.without(found.base, now, gain.name)
            part = part_beside(self.explained(without, now, explainable), foretold, explainable)
            likely = part * chance_of(self.model, undenied, gain)
            if likely < SCARCELY and not self.restores(without, now):
                scarce.append(gain)
        return scarce

    def _firm(
        self, found: RobotFindings
    ) -> tuple[list[RobotGain], RobotFit, list[Mapping[str, Any]]]:
        """Names not refused by themselves, the fit with them, and those that are.

        While one is, those that are left are asked again without it.
        """
        taken, now = list(found.taken), found.fit
        rejected: list[Mapping[str, Any]] = []
        quiet = bool(taken) and self.quiet(found.base)
        calm = bool(taken) and len(self.at_ends(found.base)) <= ENDS and self.placid(found.base)
        asked: list[RobotGain] = []
        while left := [gain for gain in taken if gain not in asked]:
            if because := self._refused(found, now, left[0], calm=calm, quiet=quiet):
                now = self.without(found.base, now, left[0].name)
                taken.remove(left[0])
                rejected.append(self._taken_back(left[0], because))
                asked = []
            else:
                asked.append(left[0])
        return taken, now, rejected

    def _no_part(
        self, now: RobotFit, without: Mapping[str, RobotFit], before: float, left: float
    ) -> list[str]:
        """Names, no register asking for them, of those that leave half of what samples are off by.

        None where samples are not far over noise, nor were, or little decides how a robot lies.
        ``without`` has the fit without each.
        """
        if not leaves_most(before, left, self.sound_rad) or self.fallen(now):
            return []
        return [name for name, fit in without.items() if not self.restores(fit, now)]

    def _plays(self, base: RobotFit, now: RobotFit, before: float) -> bool:
        """Whether samples rattle with play: as shaking has it, or means, that it takes a part of.

        ``before`` is the square of means without any name [rad^2].
        """
        if any(map(is_play, base.names)):
            return True
        if not any(map(is_play, now.names)):
            return False
        return before - self.square(now, self.judges) >= PLAYED * (before - self.floor_square)

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

        It must be of some size, and of more than an assumed number is off by; that which gained
        least must leave tolerances of servos what they are by chance. One that no register asks for
        must gain as much as beside another where positions are ``calm``, must gain on groups left
        out, must be likelier than all else, and must leave voltages as servos show them and the
        tolerances of its own joints what they are by chance. Where no more than noise is left
        without any (``quiet``), it must be more than a tolerance has, or gain much and free several
        of them from their ends: together that is more than they have.
        """
        base = found.base
        number = number_of(self.search, now, gain.name)
        if number.state == "at bound":
            return FARTHER
        if small := self._small(gain.name, *number.ci95):
            return small
        there = [other for other in found.taken if other.name in now.names]
        if gain is min(there, key=lambda other: other.deflated) and self.driven(now):
            return DRIVEN
        weak = self._weak(found, gain, calm) or self._stands_in(found, now, gain)
        if weak and not self.restores(self.without(base, now, gain.name), now):
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

    def _stands_in(self, found: RobotFindings, now: RobotFit, gain: RobotGain) -> str:
        """Why a name is there for something that has none; nothing if it is not."""
        if self.volts_denied(now) and not is_play(gain.name):  # no voltage makes teeth loose
            return OTHER_VOLTS
        if self.pulled(now, gain.name):
            return STANDS_IN
        for rival in close_rivals(self.model, found, gain):
            ends = number_of(self.search, rival.fit, rival.name).ci95
            if self._small(rival.name, *ends) == ASSUMED:
                return AS_WELL
        return ""

    def _small(self, name: str, low: float, high: float) -> str:
        """Why a name of such an interval may be none: of no size, or of a number only assumed."""
        doubt = max((n.doubt for n in self.model.nuisances if name in n.same), default=0.0)
        off = self.model.placed[name].parameter.off
        if low > off * (1.0 + doubt) or high < off * (1.0 - doubt):
            return ""
        return ASSUMED if doubt else NO_SIZE

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
