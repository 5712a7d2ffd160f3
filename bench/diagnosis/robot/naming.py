"""What may be named of a whole robot: what is asked in which order, and what is taken back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..watch import OutOfTimeError
from .effects import SINGLE
from .fit import RobotFit
from .gains import NEEDED, RobotGain
from .model import RATTLING, Progress, is_play
from .rattling import Rattling, Shaker, is_spring
from .rising import Riser, Rising
from .search import RobotSearch
from .settling import LAST, Named, RobotJudges


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """All that is named: by means over the phase, by shaking, or as a robot stands up.

    ``base`` is the fit of what the operator believes, ``named`` what means over the phase tell.
    """

    base: RobotFit
    named: Named
    shaker: Shaker | None = None
    riser: Riser | None = None

    @property
    def whole(self) -> RobotFit:
        """The fit with all that is named."""
        return self.named.after if self.shaker is None else self.shaker.beside(self.named.after)


class Naming:
    """Searches by each thing that tells, one after the other. Fits are said to ``tell``."""

    def __init__(
        self,
        search: RobotSearch,
        held: RobotJudges,
        rattling: Rattling,
        rising: Rising,
        tell: Progress,
    ) -> None:
        self.search, self.held, self.tell = search, held, tell
        self.rattling, self.rising = rattling, rising
        self._risers: dict[tuple[RobotFit, frozenset[str]], Riser | None] = {}

    def answer(self, without: frozenset[str]) -> Answer:
        """All that can be named but what must not: play first, springs and a weak source last.

        Play comes first since means over the phase of a robot that rattles mislead. A robot that
        stands up, and one that hunts on springs, are looked at where nothing rattles.
        """
        base = begun = self.search.believed()
        shaker = self._shaker(base, without)
        if shaker is not None:
            # what rattles leaves much that no name explains: one search is enough
            begun, without = self._with_play(base, shaker), without | RATTLING
        named = self.named(begun, without, shaker is None)
        if shaker is None:
            if self.rattling.denies(named.after):
                named = self._without_play(named)
        elif not self.rattling.bears_out(shaker.beside(named.after)):
            if shaker.gain.name in named.after.names:
                bare = self.held.without(begun, named.after, shaker.gain.name)
                named = named._replace(after=bare)
            shaker, named = None, named._replace(found=replace(named.found, base=base))
        if shaker is not None:
            return Answer(base, named, shaker)
        named, riser = self._risen(named, without)
        if riser is not None:
            return Answer(base, named, riser=riser)
        return Answer(base, named, self._springs(base, named.taken, without))

    def _shaker(
        self, base: RobotFit, without: frozenset[str], asked: Callable[[str], bool] = is_play
    ) -> Shaker | None:
        """Play that shaking shows, or another kind that is asked for, if there is time."""
        try:
            return self.rattling.named(base, without, asked)
        except OutOfTimeError:
            return None

    def _springs(
        self, base: RobotFit, taken: Sequence[RobotGain], without: frozenset[str]
    ) -> Shaker | None:
        """Springs that a robot hunts on, where nothing that means show has a name."""
        if taken or self.held.consistent(base):
            return None
        return self._shaker(base, without, is_spring)

    def _risen(self, named: Named, without: frozenset[str]) -> tuple[Named, Riser | None]:
        """What shows as a robot stands up, if there is time, and what was named beside it.

        Names that are needed beside it stay. Where none does, and more than noise is left of the
        gait, there is another search that begins with it.
        """
        found, taken, after, rejected = named
        riser = self._riser(after, without)
        if riser is None:
            return named, None
        now, kept = riser.gain.fit, []
        for gain in taken:
            bare = self.held.without(found.base, now, gain.name)
            if (bare.cost - now.cost) / gain.inflation < NEEDED:
                now = bare
            else:
                kept.append(gain)
        if kept or self.held.consistent(now):
            return Named(found, kept, now, rejected), riser
        effect = self.search.model.placed[riser.gain.name].effect.name
        try:
            found, kept, now, more = self.searched(now, without | {effect}, again=False)
        except OutOfTimeError:
            return Named(found, kept, now, rejected), riser
        return Named(found, kept, now, [*rejected, *more]), riser

    def _riser(self, after: RobotFit, without: frozenset[str]) -> Riser | None:
        """What shows as the robot stands up beside a fit to its gait, if there is time."""
        asked = after, without
        with suppress(OutOfTimeError):
            if asked not in self._risers:
                self._risers[asked] = self.rising.named(after, without)
        return self._risers.get(asked)

    def _with_play(self, base: RobotFit, play: Shaker) -> RobotFit:
        """What the operator believes with as much play as shaking says, where that is no worse.

        Where much rattles, means over the phase are nearer to those of a robot without.
        """
        name = play.gain.name
        self.search.sight.held[name] = play.knob
        loose = self.search.thoroughly((name,), np.array([play.knob]), base.noise)
        return loose if loose.cost < base.cost else base

    def _without_play(self, named: Named) -> Named:
        """What was found but play that shaking denies."""
        kept, after = [], named.after
        for gain in named.taken:
            if is_play(gain.name):
                after = self.held.without(named.found.base, after, gain.name)
            else:
                kept.append(gain)
        return named._replace(taken=kept, after=after)

    def named(self, base: RobotFit, without: frozenset[str], again: bool) -> Named:
        """What :meth:`searched` gives; of what is consistent without a name there is one search.

        Where such a robot stands there is none: chance moves it, and likelihoods follow that. Nor
        is the zero of any joint named where robots stand, as chance drags zeros to their ends.
        """
        if not self.held.consistent(base):
            return self.searched(base, without | SINGLE if self.held.stands else without, again)
        found, rejected = self.search.nothing(base), list[Mapping[str, Any]]()
        with suppress(OutOfTimeError):
            if not self.held.stands:
                found, taken, after, rejected = self.searched(base, without, again=False)
                if taken:
                    return Named(found, taken, after, rejected)
        # what was consistent is so, wherever else fits without a name have led
        return Named(replace(found, base=base, fit=base, taken=()), [], base, rejected)

    def searched(self, base: RobotFit, without: frozenset[str], again: bool) -> Named:
        """What a search found, the names that hold, the fit with them, and those taken back.

        No more names are looked for where a robot with them is as far from its recordings as one
        that is as believed. Where the first name is taken back there is a second search without it,
        if there is time, and if it shall search ``again``; not where others are as likely, or would
        stand in for the same.
        """
        done, far, volts = self.held.consistent, self.held.far, self.held.volts_denied

        def risen(fit: RobotFit) -> bool:  # not asked of a robot that rattles
            return not without >= RATTLING and self._riser(fit, without) is not None

        found = self.search.run(without=without, base=base, done=done, far=far, volts=volts)
        named = self.held.kept(found, self.tell, risen)
        last = any(row["because"] in LAST for row in named.rejected)
        if not again or not found.taken or found.taken[0] in named.taken or last:
            return named
        without |= {self.search.model.placed[found.taken[0].name].effect.name}
        try:
            found = self.search.run(without=without, base=base, done=done, far=far, volts=volts)
        except OutOfTimeError:
            return named
        second = self.held.kept(found, self.tell, risen)
        return second._replace(rejected=[*named.rejected, *second.rejected])
