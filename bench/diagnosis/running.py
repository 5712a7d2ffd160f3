"""A diagnosis as a user runs it: recordings in, a folder of answers out."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from bench.recording import Recording
from busemu.tables import Robot
from sim.effects import Effect
from sim.model import read_model

from .improved import write_improved
from .joint import JointFindings, diagnose_joint
from .knobs import joint_effects
from .observed import Observed, observe
from .search import Progress

HELD_OUT_OF = 4  #: one group of so many judges, when nobody says which
LEAST_GROUPS = 3  #: with fewer, all are used to fit, and the report says so


class DiagnosisError(ValueError):
    """Recordings or a robot that cannot be diagnosed: what, and what to do."""


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Recordings to fit, and recordings that only judge."""

    fitted: tuple[Recording, ...]
    judging: tuple[Recording, ...]


def group_of(recording: Recording) -> str:
    """The group a recording belongs to: repeats of one experiment share it."""
    return str(recording.metadata.get("group") or recording.name)


def split(recordings: Sequence[Recording]) -> Split:
    """Hold every fourth group out, never part of a group."""
    groups = sorted({group_of(r) for r in recordings})
    if len(groups) < LEAST_GROUPS:
        return Split(tuple(recordings), ())
    judging = set(groups[HELD_OUT_OF // 2 :: HELD_OUT_OF])
    return Split(
        tuple(r for r in recordings if group_of(r) not in judging),
        tuple(r for r in recordings if group_of(r) in judging),
    )


def diagnose(
    robot: Robot,
    parts: Split,
    *,
    without: Sequence[str] = (),
    seed: int = 0,
    say: Progress = lambda _: None,
) -> list[JointFindings]:
    """Diagnose every joint of a rig that the recordings speak of.

    ``without`` names effects that are taken out of the catalogue. Raises :class:`DiagnosisError`,
    :class:`bench.recording.RecordingError` and :class:`sim.entries.PhysicsError`.
    """
    base = read_model(robot)
    effects = without_effects(without)
    if len(base.joints) != 1:
        raise DiagnosisError(
            f"{robot.name} has {len(base.joints)} joints: this diagnosis is for rigs of one joint"
        )
    joint = base.joints[0].name
    fitted = observe(parts.fitted, robot, joint)
    judging: Sequence[Observed] = observe(parts.judging, robot, joint) if parts.judging else ()
    return [diagnose_joint(base, robot, fitted, judging, effects=effects, seed=seed, say=say)]


def without_effects(names: Sequence[str]) -> Mapping[str, Effect]:
    """The catalogue for one joint, less some effects. Raises :class:`DiagnosisError`."""
    effects = joint_effects()
    if unknown := sorted(set(names) - set(effects)):
        raise DiagnosisError(
            f"no effect named {unknown[0]!r} for one joint: use of {', '.join(sorted(effects))}"
        )
    return {name: e for name, e in effects.items() if name not in names}


def write(robot: Robot, findings: Sequence[JointFindings], out: Path, on: date) -> None:
    """Write ``diagnosis.json`` and ``model.toml``, each whole or not at all."""
    out.mkdir(parents=True, exist_ok=True)
    (only,) = findings
    text = json.dumps(only.diagnosis.document(), indent=1, allow_nan=False, default=float)
    temporary = out / "diagnosis.json.part"
    temporary.write_text(text + "\n", "utf-8")
    os.replace(temporary, out / "diagnosis.json")
    write_improved(robot, findings, out / "model.toml", on)
