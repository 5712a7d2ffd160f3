"""What recordings that judge say of a fit: what it leaves, and whether that is more than noise."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import chi2

from busemu.tables import Robot

from ..joint.rivals import CLOSE
from .denials import Denials
from .features import RobotKind
from .fit import REGISTERS, RobotFit
from .gains import RobotFindings
from .improved import of_settings
from .judging import floor_rad, judge, rmse_rad, steady_rmse_rad
from .nuisances import RobotNuisance
from .rest import Rest, rest_of
from .search import AT_END
from .sizes import BETWEEN, best_size

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
#: chance below which tolerances of a name's own joints are not what they are by themselves: of
#: thirteen true names in opened proofs the least was 0.10, of a wrong one it was 0.002;
#: and those of all servos, one way: of 34 answers without a wrong name the least was 0.03, of two
#: wrong ones it was 0.001 and 0.002
PULLED = 0.01
#: tolerances of how much a servo does about being off, by the first words of their names
DRIVES = ("gain", "motors", "torque")
FALLEN = 30.0  #: floors of misfit beyond which a robot stands or lies otherwise; assumed


def far_off(rms_rad: float, floor_rad: float) -> bool:
    """Whether walked samples are farther off than those of a sound model may be."""
    return rms_rad > SAMPLES * floor_rad


def leaves_most(before: float, left: float, floor_rad: float) -> bool:
    """Whether samples are or were far off, by more than half of what they were.

    Mean squares [rad^2].
    """
    off = before - floor_rad**2
    return far_off(max(before, left) ** 0.5, floor_rad) and before - left < PART * off


@dataclass(frozen=True, slots=True)
class Squares:
    """Mean squares of samples [rad^2]: of the steady part of recordings, and of all of them."""

    steady: float
    whole: float


@dataclass(frozen=True, slots=True, eq=False)
class Judges(Denials):
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

    def pulled(self, found: RobotFit, name: str) -> bool:
        """Whether tolerances of the joints that a name is of are off more than they are by chance.

        A name that is not true takes what it can, and they the rest, all the same way. One of the
        whole robot or of its trunk is of no joint.
        """
        where = set(self.model.placed[name].where)
        own = {j.name for j in self.model.base.joints if where & {j.name, j.name.split(".")[0]}}
        pairs = zip(self.model.nuisances, found.nuisances.tolist(), strict=True)
        squares = [z**2 for n, z in pairs if n.name.split()[-1] in own]
        return bool(squares) and float(chi2.sf(sum(squares), len(squares))) < PULLED

    def driven(self, found: RobotFit) -> bool:
        """Whether servos of all joints do more or less about being off than they do by chance.

        Gain, motors and the torques of single joints, those together, have a third each; that all
        go one way takes something that they stand in for: each may go as far alone. A supply is
        read, or else no other than a gain.
        """
        each: dict[str, list[float]] = defaultdict(list)
        for nuisance, z in zip(self.model.nuisances, found.nuisances.tolist(), strict=True):
            each[nuisance.name.split()[0]].append(z)
        ways = [sum(each[name]) / len(each[name]) ** 0.5 for name in DRIVES if each[name]]
        return bool(ways) and float(chi2.sf(sum(ways) ** 2 / len(ways), 1)) < PULLED

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
