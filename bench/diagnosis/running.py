"""A diagnosis as a user runs it: recordings in, a folder of answers out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np

from bench.files import write_json
from bench.recording import Recording
from busemu.tables import Robot
from sim.effects import Effect
from sim.model import read_model

from .joint.diagnosis import JointFindings, diagnose_joint
from .joint.fit import fit
from .joint.improved import write_improved
from .joint.model import Hypothesis, JointModel, Kind
from .joint.search import Progress
from .joint.together import together
from .journal import Journal
from .knobs import SEEN, joint_effects
from .observed import Observed, left_out, observe, stuck
from .sense import DiagnosisError
from .watch import Watch

HELD_OUT_OF = 4  #: one group of so many judges, when nobody says which
MOVING_QUANTA = 20.0  #: of the register: a joint of an arm that moves less is left out; assumed
#: effects that move every body of an arm at once, as nothing would
NOT_IN_ARMS = frozenset({"com_offset"})
LEAST_GROUPS = 3  #: with fewer, all are used to fit, and the report says so


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Recordings to fit, and recordings that only judge."""

    fitted: tuple[Recording, ...]
    judging: tuple[Recording, ...]


def group_of(recording: Recording) -> str:
    """The group a recording belongs to: repeats of one experiment share it."""
    return str(recording.metadata.get("group") or recording.name)


def split(recordings: Sequence[Recording], misfits: Mapping[str, float] | None = None) -> Split:
    """Hold every fourth group out, never part of a group: by name, or the second of every four.

    ``misfits`` says how much each group differs from what is believed. What differs most is fitted:
    an effect that one motion alone shows would be in no fit if that motion judged.
    """
    groups = sorted({group_of(r) for r in recordings})
    if len(groups) < LEAST_GROUPS:
        return Split(tuple(recordings), ())
    judging = groups[HELD_OUT_OF // 2 :: HELD_OUT_OF]
    if misfits is not None:
        worst_first = sorted(groups, key=lambda group: (-misfits.get(group, 0.0), group))
        judging = worst_first[1::HELD_OUT_OF][: len(judging)]
    return Split(
        tuple(r for r in recordings if group_of(r) not in judging),
        tuple(r for r in recordings if group_of(r) in judging),
    )


def misfits(robot: Robot, recordings: Sequence[Recording]) -> Mapping[str, float] | None:
    """How much each group differs from a rig as believed, tolerances fitted to all [rad^2].

    Nothing for a robot of several joints. Raises as :func:`diagnose`.
    """
    base = read_model(robot)
    if base.trunk is not None or len(base.joints) > 1:
        return None
    observed = [o for o in observe(recordings, robot, base.joints[0].name) if not stuck(o)]
    if not observed:
        return None
    model = JointModel(base, robot, observed)
    found = fit(model, Hypothesis(), np.zeros(len(model.nuisances)), rounds=2)
    squares: dict[str, list[float]] = {}
    for (r, kind), block in model.residuals(found.hypothesis, [found.z])[0].items():
        if kind is Kind.POSITION:
            squares.setdefault(observed[r].group, []).append(float(np.mean(block.value**2)))
    return {group: float(np.mean(some)) for group, some in squares.items()}


def diagnose(
    robot: Robot,
    parts: Split,
    *,
    without: Sequence[str] = (),
    seed: int = 0,
    say: Progress = lambda _: None,
    journal: Journal | None = None,
    known: Sequence[str] = (),
) -> list[JointFindings]:
    """Diagnose every joint of a rig or an arm that moves in the recordings, each on its own.

    In an arm the load on a joint is what the recorded motion of the others makes of it.
    ``without`` names effects that are taken out of the catalogue; ``known`` is what is odd about
    the recordings, for the limits. Where ``say`` is a :class:`Watch` and its time runs out, joints
    that were not begun are left out, and the limits say so. Raises :class:`DiagnosisError`,
    :class:`bench.recording.RecordingError` and :class:`sim.entries.PhysicsError`.
    """
    watch = say if isinstance(say, Watch) else Watch(say)
    base = read_model(robot)
    effects = without_effects(without)
    if base.trunk is not None:
        raise DiagnosisError(
            f"{robot.name} walks: this diagnosis is for rigs and arms on a fixed base"
        )
    if len(base.joints) > 1:
        effects = {name: e for name, e in effects.items() if name not in NOT_IN_ARMS}
    findings: list[JointFindings] = []
    left: list[str] = []
    for number, joint in enumerate(j.name for j in base.joints):
        alone = len(base.joints) == 1
        fitted = [o for o in observe(parts.fitted, robot, joint, needed=alone) if not stuck(o)]
        if alone and not fitted:
            raise DiagnosisError(f"{joint} stands still whatever it is told: is its torque on?")
        if not alone and not any(map(moves, fitted)):
            watch.tell(f"{joint} never moves: left out")
            left.append(f"{joint} was left out: it never moves")
            continue
        if findings and watch.late:
            left.append(f"{joint} was left out: the time was used up before")
            continue
        judging = [
            o
            for o in observe(parts.judging, robot, joint, needed=False, like=fitted)
            if not stuck(o)
        ]
        found = diagnose_joint(
            base,
            robot,
            fitted,
            judging,
            effects=effects,
            seen=SEEN - set(without),
            seed=seed,
            say=watch if alone else watch.of(joint, len(base.joints) - number),
            journal=journal,
        )
        silent = left_out((*parts.fitted, *parts.judging), (*fitted, *judging))
        findings.append(_with_limits(found, silent))
    if not findings:
        raise DiagnosisError(f"no joint of {robot.name} moves: record motions")
    return [_with_limits(found, (*left, *known)) for found in findings]


def _with_limits(found: JointFindings, more: Sequence[str]) -> JointFindings:
    limits = (*found.diagnosis.limits, *more)
    return replace(found, diagnosis=replace(found.diagnosis, limits=limits))


def moves(observed: Observed) -> bool:
    """Whether a joint moves by more in a recording than its register's rounding."""
    samples = observed.position
    return float(np.ptp(samples.value[samples.good])) > MOVING_QUANTA * samples.quantum


def without_effects(names: Sequence[str]) -> Mapping[str, Effect]:
    """The catalogue for one joint, less some effects. Raises :class:`DiagnosisError`."""
    effects = joint_effects()
    if unknown := sorted(set(names) - {*effects, *SEEN}):
        raise DiagnosisError(
            f"no effect named {unknown[0]!r} for one joint: use of {', '.join(sorted(effects))}"
        )
    return {name: e for name, e in effects.items() if name not in names}


def write(robot: Robot, findings: Sequence[JointFindings], out: Path, on: date) -> None:
    """Write ``diagnosis.json`` and ``model.toml``, each whole or not at all."""
    out.mkdir(parents=True, exist_ok=True)
    write_json(out / "diagnosis.json", together(findings).document())
    write_improved(robot, findings, out / "model.toml", on)
