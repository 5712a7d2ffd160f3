"""A joint looked at with one gear or another, and on a leash where no replay keeps step with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from busemu.tables import Robot
from sim.effects import Effect
from sim.robot import PhysicalRobot

from ..journal import Journal
from ..observed import Observed
from ..watch import Watch
from .fit import Fit, fit
from .floor import judged_floor, noise_floor, tolerance
from .gear import PLAINLY, SpringError, asked_again, believed, sprung
from .leash import GATED, HUNTS, LEASH_RAD_S
from .model import GEARS, Blocks, Hypothesis, JointModel, Kind
from .remaining import block_rms, remaining
from .rest import rest_of
from .screening import screen
from .search import confirm, drop
from .settling import Grown, Settled, settle

#: times the deviation of a sound model from which repeats that differ ask for a leash. Of 40 nulls
#: of another engine the worst have 1.9, the next 1.1
RESTLESS = 2.0
UNLIKE = 2.0  #: times what is left where it was fitted, of recordings that no other is like


@dataclass(frozen=True, eq=False)
class View:
    """A joint with one gear or another, and what is found with it."""

    model: JointModel
    before: Fit
    judge: JointModel
    start: Blocks
    floor: float
    floors: Mapping[Kind, float]
    settled: Settled

    @cached_property
    def structured(self) -> bool:
        """Whether something is left that is more than noise and what engines differ by."""
        return rest_of(self.model, self.judge, self.settled.after, self.floor).structured

    @cached_property
    def repeats(self) -> float:
        """By how much repeats differ [rad] in what is left by what was found, or rounding."""
        after = self.settled.after
        left = self.model.residuals(after.hypothesis, [after.z])[0]
        return noise_floor(self.model.observed, left)

    @property
    def restless(self) -> bool:
        """Whether repeats differ by so much that something that is the matter may seem noise."""
        return self.repeats > RESTLESS * tolerance(self.model.floors()[Kind.POSITION])


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """What a search for causes starts from, whichever recordings are fitted."""

    base: PhysicalRobot
    robot: Robot
    effects: Mapping[str, Effect]
    journal: Journal | None
    refresh_s: float | None
    watch: Watch

    def look(self, observed: Sequence[Observed], judged: Sequence[Observed]) -> View:
        """What is found in some recordings, with the gear that follows them."""
        view = self._free(observed, judged)
        if self.watch.stopped is not None or not (view.structured or view.restless):
            return view
        return self._led(view) or view

    def _free(self, observed: Sequence[Observed], judged: Sequence[Observed]) -> View:
        model, before = believed(self.base, self.robot, observed, self.journal, self.refresh_s)
        try:
            view = self._with(model, before, judged, asked_again(model))
        except SpringError:
            view = None
        if view is not None and not (GEARS & set(view.settled.thought_of)):
            return view
        if self.watch.stopped is None and (other := sprung(model)) is not None:
            self.watch.tell("the gear as the robot file has it")
            again = self._with(*other, judged)
            if view is None or again.settled.after.cost < view.settled.after.cost + PLAINLY:
                return again
        assert view is not None, "a search that was given up had time, and the file a spring"
        return view

    def _led(self, free: View) -> View | None:
        """What is found on a leash, if the joint hunts and that leaves nothing to be explained.

        Where repeats differ so much that all seems noise, what is found may leave something: what
        repeats differ by with it is the floor then.
        """
        self.watch.tell("replays on a leash: trying every effect")
        model = free.model.led(LEASH_RAD_S)
        before = fit(model, Hypothesis(), free.before.z)
        if not self._hunts(free.model, model, before):
            return None
        judged = [] if free.judge is free.model else free.judge.observed
        view = self._with(model, before, judged)
        if not view.settled.taken:
            return None
        if free.restless and not view.restless:
            return replace(view, floor=min(view.floor, view.repeats))
        if view.structured:
            return None
        self.watch.tell("what is named on a leash, without it")
        loose = self._with(free.model, free.before, judged, found=self._let_go(free, view))
        return loose if loose.settled.taken and not loose.structured else view

    def _let_go(self, free: View, led: View) -> Grown:
        """What was found on a leash, fitted without it."""
        after, names = led.settled.after, [gain.effect for gain in led.settled.taken]
        found = fit(free.model, after.hypothesis, after.z)
        gains = [drop(free.model, found, name)[1] for name in names]
        return found, gains, led.settled.confirmed

    def _hunts(self, free: JointModel, led: JointModel, before: Fit) -> bool:
        """Whether an effect follows the recordings on a leash, and loses their way without one."""
        for _, name, start in screen(led, before, self.effects.values())[:GATED]:
            gain = confirm(led, before, self.effects[name], start)
            on_leash, without, off = (
                block_rms(remaining(model, found), Kind.POSITION)
                for model, found in ((led, gain.fit), (led, before), (free, gain.fit))
            )
            if min(without, off) > HUNTS * on_leash:
                return True
        return False

    def _with(
        self,
        model: JointModel,
        before: Fit,
        judged: Sequence[Observed],
        ask: Callable[[Fit], None] = lambda _: None,
        found: Grown | None = None,
    ) -> View:
        judge = model.of(judged) if judged else model
        start = model.residuals(Hypothesis(), [before.z])[0]
        floor = noise_floor(model.observed, start)
        if judged:
            left = judge.residuals(Hypothesis(), [before.z], kinds=(Kind.POSITION,))[0]
            floor = judged_floor(floor, judge.observed, left)
        floors = {kind: noise.total for kind, noise in before.noise.items()} | {
            Kind.POSITION: tolerance(floor)
        }
        others = judge if judged else None
        known = (self.effects, floor, floors, self.watch)
        settled = settle(model, others, before, *known, ask, found)
        return View(model, before, judge, start, floor, floors, settled)


def unlike(view: View) -> frozenset[str]:
    """Recordings that judge, and must be fitted as well for anything to be found; mostly none.

    A limit is in no recording but those that reach it. Where those that were held out have a
    structured rest of a size that those that were fitted do not have, half of each group's repeats
    are fitted after all; the others, of the same motions, judge.
    """
    model, judge, after = view.model, view.judge, view.settled.after
    if judge is model or not view.structured:
        return frozenset()
    rest = [block_rms(remaining(some, after), Kind.POSITION) for some in (model, judge)]
    if rest[1] < UNLIKE * rest[0]:
        return frozenset()
    groups: dict[str, list[str]] = {}
    for one in judge.observed:
        groups.setdefault(one.group, []).append(one.name)
    return frozenset(name for names in groups.values() for name in names[: len(names) // 2])
