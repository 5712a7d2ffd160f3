"""Whether recordings can be diagnosed at all: whose they are, whether their numbers can be right.

What :mod:`bench.recording.oddities` calls serious is no physics: a diagnosis of it would name a
cause for a unit that was mixed up.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bench.recording import Recording, RecordingError
from bench.recording.oddities import Weight, oddities
from busemu.tables import Robot
from busemu.wording import amount

from .joint.search import Progress

STUCK = "stuck"  #: an oddity of one joint only: the others may be diagnosed
#: oddities that a reader of a diagnosis has to know of
TOLD = frozenset(
    {
        STUCK,
        "beyond_voltage_limit",
        "gaps",
        "glitches",
        "lost_replies",
        "repeated_times",
        "shuffled_rows",
        "supply_contradicted",
        "without_effect",
    }
)


class DiagnosisError(ValueError):
    """Recordings or a robot that cannot be diagnosed: what, and what to do."""


def check_servos(recording: Recording, robot: Robot) -> None:
    """Raise :class:`RecordingError` for a recording of other servos than the robot's."""
    for servo_id in recording.servo_ids:
        mount = robot.by_id.get(servo_id)
        if mount is None:
            known = ", ".join(str(i) for i in sorted(robot.by_id))
            raise RecordingError(
                recording.path,
                f"servo {servo_id} is none of {robot.name} (it has {known}): "
                "is this a recording of another robot?",
            )
        model = recording.models.get(servo_id)
        if model is not None and model.model != mount.model:
            raise RecordingError(
                recording.path,
                f"servo {servo_id} is {model.model}, but {mount.model} in {robot.name}: "
                "is this a recording of another robot?",
            )


def check_motion(recordings: Sequence[Recording], robot: Robot) -> None:
    """Raise :class:`DiagnosisError` where nothing ever moves: that says nothing about a model."""
    spans = []
    for recording in recordings:
        for servo_id in robot.by_id:
            raw = recording.series(servo_id, "present_position", "read").value
            if len(raw):
                spans.append((float(raw.min()), float(raw.max()), servo_id))
    for servo_id in {servo for _, _, servo in spans}:
        own = [(low, high) for low, high, servo in spans if servo == servo_id]
        if min(low for low, _ in own) < max(high for _, high in own):
            return
    if spans:
        raise DiagnosisError(
            f"present_position never changes in {amount(len(recordings), 'recording')}: "
            "record motions, or look with busemu inspect at what was recorded"
        )


def check_numbers(
    recordings: Iterable[Recording], say: Progress = lambda _: None
) -> tuple[str, ...]:
    """Refuse what cannot be right; what is odd but bearable is told, a line a kind.

    Raises :class:`RecordingError` for the first serious oddity, except a joint that is stuck: the
    others go on.
    """
    told: dict[str, list[str]] = {}
    say("looking at the numbers that were recorded")
    for recording in recordings:
        for odd in oddities(recording).found:
            place = odd.where(_start_s(recording))
            if odd.weight is Weight.SERIOUS and odd.kind != STUCK:
                raise RecordingError(
                    recording.path, f"{place}: {odd.what}; {odd.advice} (busemu inspect shows it)"
                )
            if odd.kind in TOLD:
                there = f"{recording.name}, {place}: {odd.what}"
                told.setdefault(odd.kind, []).append(there)
    return tuple(
        some[0] + (f"; and {len(some) - 1} more like it" if len(some) > 1 else "")
        for some in told.values()
    )


def _start_s(recording: Recording) -> float:
    return float(recording.table["t_s"][0].as_py()) if len(recording) else 0.0
