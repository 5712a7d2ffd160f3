"""The diagnosis of a whole robot: from recordings of all its joints to a verdict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.recording import Recording
from busemu.tables import Robot
from sim.model import Addition, read_model

from ..journal import Journal
from ..result import Cause, Diagnosis, Estimate, FitSummary, NextExperiment, beside_rest, verdict_of
from .causes import as_measured, cause_of, close_rivals
from .channels import channels, ranking
from .features import RobotKind
from .fit import RobotFit
from .gains import RobotFindings, RobotGain
from .improved import of_causes, of_nuisances
from .judging import Judgement, floor_rad, judge, rmse_rad, steady_rmse_rad
from .limits import far_samples, in_series, limits, other_duties, other_volts, stand_in
from .model import Progress, RobotModel
from .naming import Naming
from .next import next_experiments
from .nuisances import LATE
from .places import mismatch, moved
from .rattling import Rattling, still_far, told, worsened
from .replay import course
from .rest import Rest
from .rising import Rising, risen
from .search import RobotSearch
from .settling import RobotJudges

Floats = NDArray[np.float64]

PLACES = 6  #: of a joint in stance or swing whose rest is told in details, the most foretold


@dataclass(frozen=True, slots=True, eq=False)
class RobotDiagnosis:
    """A diagnosis with what pictures and the better model are made from.

    ``believed`` and ``better`` are the recordings that judge, under the model as the operator has
    it with ordinary tolerances fitted, and with what was found; ``additions`` is what the better
    model adds to the robot's file.
    """

    diagnosis: Diagnosis
    additions: tuple[Addition, ...]
    believed: tuple[Judgement, ...]
    better: tuple[Judgement, ...]


def diagnose_robot(
    robot: Robot,
    fitted: Sequence[Recording],
    judging: Sequence[Recording],
    *,
    without: Iterable[str] = (),
    on: str = "",
    say: Progress = lambda _: None,
    tell: Progress | None = None,
    journal: Journal | None = None,
) -> RobotDiagnosis:
    """Diagnose a legged robot on recordings that read the positions of all its joints.

    ``without`` names effects of the catalogue that may not be named; ``on`` is the day, for the
    better model. Replays are kept in the ``journal``. Stages of what may be left undone are said to
    ``say``, which may raise :class:`OutOfTimeError`, and those that an answer needs to ``tell`` (if
    None: to ``say`` as well). Raises :class:`bench.recording.RecordingError`, and
    :class:`OutOfTimeError` where there is no answer yet.
    """
    courses = [course(recording, robot) for recording in (*fitted, *judging)]
    which = list(range(len(fitted)))
    judges = list(range(len(fitted), len(courses)))
    base = read_model(robot)
    with RobotModel(base, robot, courses, say, judging=judges, journal=journal) as model:
        work = Work(model, robot, which, judges, on, say, tell or say)
        return work.diagnosed(frozenset(without))


class Work:
    """A diagnosis that is being made: some recordings fit, the others (or the same) judge.

    ``say`` and ``tell`` are those of :func:`diagnose_robot`.
    """

    def __init__(
        self,
        model: RobotModel,
        robot: Robot,
        which: list[int],
        judges: list[int],
        on: str,
        say: Progress,
        tell: Progress,
    ) -> None:
        self.model, self.robot, self.tell = model, robot, tell
        self.which, self.judges, self.held_out = which, judges or which, bool(judges)
        groups = sorted({model.observed[r].group for r in which})
        self.told = f"fitted to recordings {', '.join(groups)}" + (f"; {on}" if on else "")
        self.search = RobotSearch(model, which, say=say)
        self.held = RobotJudges(self.search, which, self.judges, robot, self.held_out)
        self.rattling = Rattling(model, which, self.judges, say)
        rising = Rising(self.search, which, self.judges, say)
        self.naming = Naming(self.search, self.held, self.rattling, rising, tell)

    def diagnosed(self, without: frozenset[str]) -> RobotDiagnosis:
        """Search, judge, and say what was found."""
        model = self.model
        answer = self.naming.answer(without)
        found, taken, after, rejected = answer.named
        shaker, riser, whole = answer.shaker, answer.riser, answer.whole
        rest = self.held.rest(after)
        self.tell("replaying the recordings that judge")
        causes, nexts, extra = self._causes(found, taken, after, rest)
        beside = []
        for one in (shaker, riser):
            if one is None:
                continue
            causes.append(one.cause)
            placed = model.placed[one.gain.name]
            extra += of_causes([(placed, one.cause.parameters)], self.told)
            beside.append((one.gain, one.cause.shown_by))
        causes = [as_measured(cause) for cause in causes]
        base = answer.base
        found = replace(found, base=base) if beside else found
        shaken, shook = self.rattling.more(whole), self.rattling.left(base, self.judges)
        shakes = self.rattling.left(whole, self.judges)
        believed = judge(model, self.robot, base.nuisances, (), self.judges)
        better = believed
        if extra:
            better = judge(model, self.robot, after.nuisances, extra, self.judges)
        shown = [model.features[r] for r in self.judges]
        rmse = [steady_rmse_rad(shown, judged) for judged in (believed, better)]
        fit = FitSummary(
            before=rmse[0],
            after=rmse[1],
            noise_floor=floor_rad(model, self.judges),
            held_out=self.held_out,
            recordings=tuple(model.observed[r].name for r in self.judges),
        )
        # what shows as a robot stands up explains nothing of how it walks
        bare = len(causes) == (riser is not None)
        ends = self.held.strained(after, found.in_vain) if bare else ()
        unlike = still_far(causes, fit, shaker, bare=bare)
        volts = self.held.volts_denied(after)
        off = self.held.duties_denied(after)
        left = (
            bool(ends or volts or off or unlike) or rest.structured or worsened(causes, fit, shaker)
        )
        verdict = verdict_of(bool(causes), left)
        ordinary = of_nuisances(model.base, model.nuisances, after.nuisances.tolist(), self.told)
        diagnosis = Diagnosis(
            verdict=verdict,
            mismatch=self._mismatch(whole) if verdict != "consistent" else (),
            causes=tuple(sorted(causes, key=lambda c: -c.held_out_gain_nats)),
            fit=fit,
            unexplained=rest.told() if rest.structured or ends or unlike else (),
            next_experiment=tuple(nexts),
            limits=(
                *limits(model, after, self.which, self.held_out),
                *stand_in(ends),
                *other_volts(volts),
                *other_duties(off, self.held.duties_most(after)[1]),
                *(far_samples(fit) if unlike else ()),
                *in_series(causes),
                *told(shaker, shakes, shook, shaken),
                *risen(riser),
            ),
            channels=channels(self.held, found, after),
            rejected=tuple(rejected),
            ranking=ranking(found, whole, beside, self._taken_back(rejected)),
            details=self._details(found, after, rest)
            | {"whole_rmse_rad": {"before": rmse_rad(believed), "after": rmse_rad(better)}}
            | {
                "shaking": {
                    "named": shaker is not None,
                    "before_nats": shook,
                    "left_nats": shakes,
                    "log_ratio": shaken,
                }
            },
        )
        return RobotDiagnosis(diagnosis, (*extra, *ordinary), tuple(believed), tuple(better))

    def _taken_back(self, rejected: Iterable[Mapping[str, Any]]) -> dict[str, str]:
        """Why names were taken back, by what is placed."""
        why = {(row["effect"], tuple(row["scope"])): str(row["because"]) for row in rejected}
        every = {name: (p.effect.name, tuple(p.where)) for name, p in self.model.placed.items()}
        return {name: why[own] for name, own in every.items() if own in why}

    def _mismatch(self, after: RobotFit) -> tuple[dict[str, Any], ...]:
        """Where what is named moves the robot; without a name, where more is left than noise.

        Tolerances at their ends move it as well: whatever they stand in for is not as believed, nor
        is what they take away explained. Where that is no more than noise, it is told where they
        move it. Of when goals act neither end is a finding.
        """
        model, joints = self.model, RobotKind.JOINTS
        ends = self.held.at_ends(after)
        odd = [n in ends and n.name != LATE for n in model.nuisances]
        ordinary = np.where(odd, 0.0, after.nuisances)
        rows = []
        for settings, z in ((after.settings, after.nuisances), ((), ordinary)):
            model.recentre(settings, z, self.which)
            rows.append([model.modelled(settings, z, r)[joints] for r in self.which])
        if not after.names:
            blocks = model.residuals((), ordinary, self.which)
            if left := mismatch(model, {r: blocks[r, joints].value for r in self.which}):
                return left
        apart = [one - other for one, other in zip(*rows, strict=True)]
        return moved(model, dict(zip(self.which, apart, strict=True)))

    def _causes(
        self, found: RobotFindings, taken: Sequence[RobotGain], after: RobotFit, rest: Rest
    ) -> tuple[list[Cause], list[NextExperiment], list[Addition]]:
        """Named causes, what would tell them from their rivals, and what they add to the file."""
        causes, nexts = [], []
        placed: list[tuple[Any, Mapping[str, Estimate]]] = []
        explainable = self.held.explainable(found.base, after)
        found = self.held.undenied(found)
        for gain in taken:
            without = self.held.without(found.base, after, gain.name)
            explained = self.held.explained(without, after, explainable)
            held_out = gain.deflated
            if gain.held_out is not None:
                held_out = gain.held_out / gain.inflation
            elif self.held_out:
                held_out = (self.held.outside(without) - self.held.outside(after)) / gain.inflation
            cause = cause_of(self.search, found, gain, after, explained, held_out)
            causes.append(beside_rest(cause, rest.foretold, explainable))
            placed.append((self.model.placed[gain.name], cause.parameters))
            if len(taken) == 1 and (rivals := close_rivals(self.model, found, gain)):
                self.tell(f"what would tell {gain.name} from its rivals")
                nexts += next_experiments(
                    self.search.sight,
                    self.robot,
                    after,
                    {rival.name: rival.fit for rival in rivals},
                    gain.inflation,
                )
        return causes, nexts, of_causes(placed, self.told)

    def _details(self, found: RobotFindings, after: RobotFit, rest: Rest) -> dict[str, Any]:
        return {
            "replays": self.model.replays.count,
            "phase_rms_rad": {
                "with_tolerances": self.held.square(found.base, self.which) ** 0.5,
                "after": self.held.square(after, self.which) ** 0.5,
                "after_held_out": rest.rms_rad,
            },
            "nuisances": {
                n.name: {"value": float(x) * n.deviation, "deviations": float(x), "unit": n.unit}
                for n, x in zip(self.model.nuisances, after.nuisances.tolist(), strict=True)
            },
            "over_noise": {
                "fitted": self.held.over_noise(found.base, self.which),
                "judged": self.held.over_noise(found.base, self.judges),
            },
            "remainder": {
                "predicted_rad": rest.predicted_rad,
                "share": rest.share,
                "agreeing": rest.agreeing,
                "places": [asdict(place) for place in rest.places[:PLACES]],
            },
            "seen_from": {
                s.name: size
                for s in found.screened
                if np.isfinite(s.floor_z)
                and np.isfinite(size := self.model.placed[s.name].knob.value(s.floor_z))
            },
        }
