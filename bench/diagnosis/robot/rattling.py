"""Play in teeth, and springs that a robot hunts on, named by how much joints shake.

Where legs rattle, means over the phase are chance: replays are as far from each other as recordings
are, so that these means neither show play nor deny it. How much joints shake does both, and tells
it from what else may make them shake: all effects are tried on that alone, on the robot as
believed, as tolerances make no difference there that counts. On very soft springs joints swing to
and fro, and when is chance as well: so these are looked for where means have named nothing. No
other effect is named by shaking: of those, means over the phase say more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..joint.rest import is_worse
from ..noise import huber, whiten
from ..result import Cause, FitSummary
from .causes import cause_of
from .features import RobotKind
from .fit import RobotFit
from .gains import NEEDED, RobotGain
from .judges import LITTLE, far_off, leaves_most
from .model import RATTLING, Progress, RobotModel, is_play
from .screen import Screened
from .search import RobotSearch
from .shaking import by_kind
from .sought import Sought
from .steps import BESIDE, HELD_OUT

#: fits of one hypothesis to shaking end so many nats apart: no tolerances lead them astray, and
#: other starts of its replays make 0.8 nats, measured of play of 5 degrees in two joints of a leg
SHAKEN_APART_NATS = 2.0
HUNTING = "joint_compliance"  #: effect on much of which a robot hunts


def is_spring(name: str) -> bool:
    """Whether a placed effect makes a joint give, so that a robot may hunt."""
    return name.partition("@")[0] == HUNTING


@dataclass(frozen=True, slots=True, eq=False)
class Shaker:
    """What makes joints shake, play or springs: the gain that was taken, and the cause."""

    gain: RobotGain
    cause: Cause

    @property
    def knob(self) -> float:
        """How much of it."""
        return float(self.gain.fit.knobs[-1])

    def beside(self, after: RobotFit) -> RobotFit:
        """A fit with this in it, if it is not."""
        if self.gain.name in after.names:
            return after
        names = (*after.names, self.gain.name)
        return replace(after, names=names, z=np.append(after.z, self.knob))


class ShakingSearch(RobotSearch):
    """A search on shaking alone: springs have no two valleys there, and samples are chance.

    One kind of effect is named by it, so nothing is tried where that is not of what promises most.
    """

    asked: Callable[[str], bool] = staticmethod(is_play)  #: whether a placed effect is of the kind

    def _sought(self, names: Collection[str]) -> Sought:
        return Sought(self.sight, {})

    def _step(self, some: Sequence[Screened], now: RobotFit, step: int) -> list[RobotGain]:
        gains = [replace(gain, apart=SHAKEN_APART_NATS) for gain in super()._step(some, now, step)]
        most = self._most(gains)
        return gains if any(self.asked(gain.name) for gain in most) else []

    @staticmethod
    def _most(promised: Sequence[RobotGain]) -> list[RobotGain]:
        """The few that promise most, of those that promise what a name needs."""
        return [gain for gain in RobotSearch._most(promised) if gain.nats >= NEEDED]

    def _from_far(self, found: RobotFit) -> RobotFit:
        return found

    def _whole_square(self, found: RobotFit) -> float:
        return 0.0


class Rattling:
    """How much joints shake in some recordings, and in those that judge."""

    def __init__(
        self, model: RobotModel, which: Sequence[int], judges: Sequence[int], say: Progress
    ) -> None:
        self.model, self.which, self.judges = model, which, judges
        self.search = ShakingSearch(model, which, (RobotKind.SHAKING,), say)

    def left(self, found: RobotFit, which: Sequence[int]) -> float:
        """What a fit leaves of shaking by exact replays, beside what engines differ by [nats]."""
        self.model.recentre(found.settings, found.nuisances, which)
        blocks = self.search.sight.blocks(found.names, found.z, which)
        noise = self.search.sight.noise(blocks)
        total = 0.0
        for (_, kind), block in blocks.items():
            out, _ = whiten(block, noise[kind], block.value[:, None])
            total += float(np.sum(huber(out[:, 0])))
        return total

    def more(self, found: RobotFit) -> dict[str, float]:
        """Logarithm of how much more joints shake than a fit does, by kind of joint and phase."""
        self.model.recentre(found.settings, found.nuisances, self.judges)
        kind = RobotKind.SHAKING
        apart = [
            self.model.recorded(r, kind)
            - self.model.modelled(found.settings, found.nuisances, r)[kind]
            for r in self.judges
        ]
        joints = [joint.name for joint in self.model.base.joints]
        return by_kind(joints, np.mean(apart, axis=0))

    def named(
        self,
        base: RobotFit,
        without: Collection[str] = (),
        asked: Callable[[str], bool] = is_play,
    ) -> Shaker | None:
        """What explains how joints shake more than as believed, where judges bear it out.

        Play, or another kind that is ``asked`` for.
        """
        left = self.left(base, self.which)
        if left < NEEDED:
            return None
        self.model.recentre((), np.zeros(len(self.model.nuisances)))
        self.search.asked = asked
        found = self.search.run(most=1, without=without, base=self.search.sight.fit())
        if not found.taken:
            return None
        (gain,) = found.taken
        outside, before = (self.left(fit, self.judges) for fit in (found.fit, base))
        if (
            not asked(gain.name)
            or left - self.left(found.fit, self.which) < NEEDED
            or before - outside < HELD_OUT
        ):
            return None
        self.model.recentre(found.fit.settings, found.fit.nuisances, self.which)
        share = 1.0 - outside / max(before, 1e-30)
        cause = cause_of(self.search, found, gain, found.fit, share, before - outside)
        return Shaker(gain, replace(cause, shown_by="how much joints shake"))

    def denies(self, after: RobotFit) -> bool:
        """Whether joints shake less than with the play that means over the phase had named."""
        plain = self._still(after)
        if len(plain.names) == len(after.names):
            return False
        return self.left(after, self.judges) - self.left(plain, self.judges) >= NEEDED

    def bears_out(self, after: RobotFit) -> bool:
        """Whether play that shaking had named is needed for that beside other names."""
        plain = self._still(after)
        needed = BESIDE if plain.names else NEEDED
        return self.left(plain, self.which) - self.left(after, self.which) >= needed

    def _still(self, found: RobotFit) -> RobotFit:
        """A fit without play, all else as it is."""
        kept = [(n, z) for n, z in found.settings if not is_play(n)]
        z = np.append(found.nuisances, [value for _, value in kept])
        return replace(found, names=tuple(name for name, _ in kept), z=z)


def worsened(causes: Iterable[Cause], fit: FitSummary, shaker: Shaker | None = None) -> bool:
    """Whether samples that are farther off with what is named speak against it.

    With play alone, or with what shaking has named, they do not: no replay rattles or hunts when
    the recording does.
    """
    shaken = None if shaker is None else shaker.cause
    others = any(cause.effect not in RATTLING and cause is not shaken for cause in causes)
    return others and is_worse(fit.before, fit.after, fit.noise_floor)


def still_far(
    causes: Iterable[Cause], fit: FitSummary, shaker: Shaker | None = None, *, bare: bool
) -> bool:
    """Whether samples say that more is the matter than what is named.

    Without a name for the gait (``bare``) where they are far off, with names where these leave most
    of that. With play, or with what shaking has named, they say nothing.
    """
    if bare:
        return far_off(fit.after, fit.noise_floor)
    if shaker is not None or any(cause.effect in RATTLING for cause in causes):
        return False
    return leaves_most(fit.before**2, fit.after**2, fit.noise_floor)


def told(
    named: Shaker | None, left_nats: float, before_nats: float, more: Mapping[str, float]
) -> tuple[str, ...]:
    """What is to be said of shaking: what was named by it, and what is left of so much before."""
    said = []
    if named is not None:
        does = "legs rattle" if is_play(named.gain.name) else "a robot hunts on soft springs"
        said.append(
            f"{named.cause.effect} was named by how much joints shake from sample to sample: when "
            f"{does} is chance, so that samples and means over the phase neither show it nor deny "
            "it, and the fit may be worse with it"
        )
    if left_nats >= max(NEEDED, LITTLE * before_nats):
        most = max(more, key=lambda kind: abs(more[kind]))
        segment, phase = most.split()
        said.append(
            f"from sample to sample, {segment} joints shake {math.exp(more[most]):.2f} times as "
            f"much as the model's in {phase}, and nothing that was tried explains it"
        )
    return tuple(said)
