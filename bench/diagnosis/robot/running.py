"""A whole robot's diagnosis as a user runs it: recordings in, a folder of answers out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

from bench.figures.style import save
from bench.files import write_json
from bench.recording import RecordingError
from busemu.tables import Robot
from sim.model import read_model

from ..journal import Journal
from ..report.traces import Trace
from ..result import Diagnosis
from ..running import Split
from ..sense import DiagnosisError
from ..watch import OutOfTimeError, Watch
from .diagnosis import RobotDiagnosis, diagnose_robot
from .effects import OUTSIDE, placed_effects
from .improved import write_model
from .judging import traces
from .overload import before_overload
from .picture import phase_figure
from .stops import past_stops


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What a whole robot's diagnosis leaves: the diagnosis, its traces, names of what fitted it."""

    diagnosis: Diagnosis
    traces: Sequence[Trace]
    fitted: tuple[str, ...]


def walks(robot: Robot) -> bool:
    """Whether a robot stands on legs of its own."""
    return bool(robot.document.get("leg")) and "trunk" in robot.document


def run_robot(
    robot: Robot,
    parts: Split,
    out: Path,
    on: date,
    *,
    without: Sequence[str] = (),
    watch: Watch,
    journal: Journal | None = None,
    known: Sequence[str] = (),
) -> Answers:
    """Diagnose a legged robot and write ``diagnosis.json``, ``model.toml`` and ``phase.png``.

    Stops that recordings went past are out of the way, in ``model.toml`` as well; what follows
    where a servo is at its limit or shut itself down is not compared. ``known`` is what is odd
    about the recordings, for the limits. Raises :class:`DiagnosisError`,
    :class:`bench.recording.RecordingError` and :class:`sim.entries.PhysicsError`.
    """
    check_names(robot, without)
    robot, moved = past_stops(robot, (*parts.fitted, *parts.judging))
    fitted, cut = before_overload(robot, parts.fitted)
    judging, cut_too = before_overload(robot, parts.judging)
    if parts.fitted and not fitted:
        raise RecordingError(parts.fitted[0].path, f"nothing is left to fit: {cut[0]}")
    parts = Split(fitted, judging)
    known = (*moved, *cut, *cut_too, *known)
    try:
        found = diagnose_robot(
            robot,
            parts.fitted,
            parts.judging,
            without=without,
            on=on.isoformat(),
            say=watch,
            tell=watch.tell,
            journal=journal,
        )
    except OutOfTimeError as early:
        raise DiagnosisError(
            f"the time is used up before {early}: give more; the same command goes on from here"
        ) from None
    diagnosis = found.diagnosis
    if watch.stopped is not None:
        known = (*known, f"the time was used up before {watch.stopped}: what follows was not tried")
        diagnosis = replace(diagnosis, details={**diagnosis.details, "stopped": watch.stopped})
    diagnosis = replace(diagnosis, limits=(*diagnosis.limits, *known))
    found = replace(found, diagnosis=diagnosis)
    write_answers(robot, found, out)
    return Answers(
        diagnosis,
        traces(robot, found.believed, found.better),
        tuple(recording.name for recording in parts.fitted),
    )


def check_names(robot: Robot, names: Sequence[str]) -> None:
    """Refuse names that are no effects of a whole robot."""
    known = {placed.effect.name for placed in placed_effects(read_model(robot)).values()}
    if unknown := sorted(set(names) - known - OUTSIDE):
        raise DiagnosisError(
            f"no effect named {unknown[0]!r} for a whole robot: use of {', '.join(sorted(known))}"
        )


def write_answers(robot: Robot, found: RobotDiagnosis, out: Path) -> None:
    """Write the files of a diagnosis, each whole or not at all."""
    out.mkdir(parents=True, exist_ok=True)
    write_json(out / "diagnosis.json", found.diagnosis.document())
    write_model(robot, found.additions, out / "model.toml")
    save(phase_figure(robot, found.believed[0], found.better[0]), out / "phase.png")
