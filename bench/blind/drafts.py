"""Drafts: a drawn case with all that is needed to write it down, whatever it is of."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.motions import ExperimentPlan, StandPlan, WalkPlan
from bench.recording import Recording
from bench.recording.metadata import FORMAT

from .believed import JOINT, robot_toml
from .case import Asked, Case, Kind, draw
from .changes import Truth
from .conceal import disguise
from .imitation import left_of
from .legged_case import READS, LeggedCase, draw_legged, nuisance_document, stance_share
from .legged_sizing import legged_floor, passing
from .measure import Measured, record
from .scenes import SCENES, Plan, Played, play
from .sizing import noise_floor

Floats = NDArray[np.float64]


class Draft(Protocol):
    """What a case folder is written from."""

    @property
    def kind(self) -> Kind:
        """How many effects, and of what kind."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the hidden effects."""

    @property
    def held_out(self) -> tuple[str, ...]:
        """Groups that are not for fitting."""

    @property
    def plans(self) -> Sequence[tuple[str, Plan]]:
        """Group and plan of every recording, repeats one after another."""

    def robot_text(self) -> str:
        """The robot file that the operator believes."""

    def measure(self, plan: Plan, name: str, group: str, late: float) -> Measured:
        """One recording; ``late`` is 0 at the session's beginning and 1 at its end."""

    def told(self) -> dict[str, Any]:
        """The key: what is true."""


def number(value: float) -> float | None:
    """JSON has no infinity: ``null`` stands for it, and for "none"."""
    return value if math.isfinite(value) else None


def parameters(truth: Truth) -> dict[str, Any]:
    """True parameters, for the key."""
    return {
        name: {"value": number(q.value), "unit": q.unit, "off": number(q.off)}
        for name, q in truth.items()
    }


class JointDraft:
    """A case of a one-joint rig."""

    def __init__(self, seed: int, asked: Asked | None) -> None:
        self.case: Case
        self.case, self._guise = disguise(draw(seed, asked))
        self.kind = self.case.kind
        self.names = tuple(hidden.name for hidden in self.case.hidden)
        self.held_out = self.case.ground.programme.held_out
        self.plans: Sequence[tuple[str, Plan]] = self.case.plans

    def robot_text(self) -> str:
        """See :class:`Draft`."""
        return robot_toml(self.case.ground.rig)

    def measure(self, plan: Plan, name: str, group: str, late: float) -> Measured:
        """See :class:`Draft`."""
        if not isinstance(plan, ExperimentPlan):
            raise ValueError(f"{self.case.ground.rig.name} has one joint and cannot walk")
        return record(self.case, plan, name, group, late)

    def told(self) -> dict[str, Any]:
        """See :class:`Draft`."""
        case, where = self.case, self.case.ground
        _, truths = case.truth(where.programme.runs[0].plan)
        told: list[dict[str, Any]] = []
        for hidden, truth in truths:
            gate = hidden.how.gate
            told.append(
                {
                    "effect": hidden.name,
                    "scope": [JOINT],
                    "parameters": parameters(truth),
                    "phase": {"kind": gate.kind.value, "low": gate.low, "high": gate.high},
                    "size": hidden.size,
                    "ratio": number(hidden.ratio),
                    "wanted_ratio": number(hidden.wanted),
                    "channel": hidden.effect.channel,
                }
            )
        masks = len(case.ordinary)
        effects = [
            {**one, "left": dataclasses.asdict(left_of(case, i))}
            for i, one in enumerate(told[masks:])
        ]
        return {
            "concealment": case.concealment.value,
            "rig": where.rig.name,
            "programme": where.programme.name,
            "style": where.style.name,
            "build": dataclasses.asdict(where.build),
            "effects": effects,
            "ordinary": told[:masks],
            "nuisances": case.nuisances.document(),
            "rival": dataclasses.asdict(case.rival) if case.rival else {},
            "disguise": self._guise,
            "noise_floor_rad": noise_floor(where.key),
            "quantum_rad": where.rig.sheet.step_rad,
        }


class LeggedDraft:
    """A case of a leg on a stand or of a whole robot."""

    def __init__(self, seed: int, asked: Asked) -> None:
        self.case: LeggedCase = draw_legged(seed, asked)
        self.kind = self.case.kind
        self.names = tuple(hidden.name for hidden in self.case.hidden)
        scene = self.case.scene
        self.held_out = scene.held_out
        self.plans: Sequence[tuple[str, Plan]] = tuple(
            (group.name, group.plan) for group in scene.groups for _ in range(group.repeats)
        )

    def robot_text(self) -> str:
        """See :class:`Draft`."""
        return self.case.scene.robot.path.read_text("utf-8")

    def measure(self, plan: Plan, name: str, group: str, late: float) -> Measured:
        """See :class:`Draft`."""
        case, scene = self.case, self.case.scene
        random = np.random.default_rng([case.seed, 23, *name.encode()])
        whole, _ = case.truth(plan)
        whole = passing(whole, late + 0.2 * float(random.uniform(-1.0, 1.0)))
        if scene.support == "suspended" and not isinstance(plan, ExperimentPlan):
            raise ValueError(f"{scene.name} is held in the air: it neither stands nor walks")
        played = play(scene, plan, whole.body, whole.electrics, reads=READS[case.style])
        table = _disturbed(played, case, random)
        recording = Recording.checked(table, _metadata(case, plan, name, group))
        return _with_truth(recording, played, 1.0 + 1e-6 * case.nuisances.clock_ppm)

    def told(self) -> dict[str, Any]:
        """See :class:`Draft`."""
        case, scene = self.case, self.case.scene
        _, truths = case.truth(scene.groups[0].plan)
        told = [
            {
                "effect": hidden.name,
                "scope": list(hidden.where.legs),
                "joints": list(hidden.joints),
                "parameters": parameters(truth),
                "phase": {"kind": "always", "low": 0.0, "high": 0.0},
                "size": hidden.size,
                "ratio": number(hidden.ratio),
                "wanted_ratio": number(hidden.wanted),
                "walking_ratio": hidden.walking(scene),
                "channel": "present_position",
            }
            for hidden, truth in truths
        ]
        position = next(iter(scene.robot.tables.values()))["present_position"]
        return {
            "concealment": case.concealment.value,
            "rig": scene.name,
            "programme": "walk" if scene.walks else "stand",
            "style": case.style,
            "effects": told[len(case.ordinary) :],
            "ordinary": told[: len(case.ordinary)],
            "nuisances": nuisance_document(case.nuisances),
            "decoy_rad": dict(case.decoy),
            "stance_share": stance_share(scene, (*case.ordinary, *case.hidden)),
            "noise_floor_rad": legged_floor(scene.name),
            "quantum_rad": position.si_scale,
        }


def _metadata(case: LeggedCase, plan: Plan, name: str, group: str) -> dict[str, Any]:
    robot, scene = case.scene.robot, case.scene
    condition: dict[str, Any] = {
        "support": scene.support,
        "supply_v": robot.document["supply"]["voltage_v"]["value"],
    }
    if isinstance(plan, WalkPlan):
        condition |= {"payload_kg": plan.payload_kg, "v_left": plan.v_left, "v_right": plan.v_right}
    elif isinstance(plan, StandPlan):
        condition |= {"payload_kg": plan.payload_kg, "programme": plan.programme}
    else:
        condition |= {"motion": plan.motion.name, "joint": plan.joint}
    registers = plan.registers if isinstance(plan, ExperimentPlan) else {}
    return {
        "format": FORMAT,
        "name": name,
        "robot": "../robot.toml",
        "source": "simulation",
        "group": group,
        "condition": condition,
        "bus": {"protocol": robot.protocol, "baud_rate": robot.baud_rate},
        "servo": {
            str(s.servo_id): {"model": s.model, "registers": {**s.registers, **registers}}
            for s in robot.servos
        },
    }


def _disturbed(played: Played, case: LeggedCase, random: np.random.Generator) -> pa.Table:
    """The table with some reads lost on their way into the log, in the host's time."""
    table = played.session.recorder.table()
    read = np.array([op == "read" for op in table.column("op").to_pylist()])
    lost = read & (random.random(len(read)) < case.nuisances.lost_rate)
    clock = 1.0 + 1e-6 * case.nuisances.clock_ppm
    changed = {
        "t_s": table.column("t_s").to_numpy() * clock,
        "t_reply_s": np.where(lost, np.nan, table.column("t_reply_s").to_numpy() * clock),
        "raw": np.where(lost, np.nan, table.column("raw").to_numpy()),
    }
    for name, values in changed.items():
        at = table.column_names.index(name)
        table = table.set_column(at, name, pa.array(values))
    return table


def _with_truth(recording: Recording, played: Played, clock: float) -> Measured:
    """Find for every read of a position the sample that it carries."""
    found: list[pa.Table] = []
    squares = []
    asked = recording.t_s
    replied = recording.table.column("t_reply_s").to_numpy()
    raws = recording.table.column("raw").to_numpy()
    for servo_id, seen in sorted(played.plant.seen.items()):
        rows = recording.rows(servo_id, "present_position", "read")
        rows = rows[~np.isnan(raws[rows])]
        if not len(rows):
            continue
        register = recording.register(servo_id, "present_position")
        read = np.array([register.to_si(int(raw)) for raw in raws[rows]])
        when, angle = np.array(seen).T
        sample = _samples(when * clock, angle, read, asked[rows], replied[rows])
        squares.append((read - angle[sample]) ** 2)
        columns = {
            "recording": pa.array([recording.name] * len(rows)).dictionary_encode(),
            "row": rows.astype(np.int64),
            "servo_id": np.full(len(rows), servo_id, dtype=np.int16),
            "t_true_s": when[sample] * clock,
            "position_rad": angle[sample],
        }
        found.append(pa.table(columns))
    truth = pa.concat_tables(found).unify_dictionaries()
    return Measured(recording, truth, float(np.mean(np.concatenate(squares))))


def _samples(
    when_s: Floats, angle_rad: Floats, read_rad: Floats, asked_s: Floats, replied_s: Floats
) -> NDArray[np.intp]:
    """Of the samples between question and answer, the one nearest to what was read."""
    first = np.searchsorted(when_s, asked_s - 1e-9)
    last = np.maximum(np.searchsorted(when_s, replied_s + 1e-9, side="right"), first + 1)
    best = [
        low + int(np.argmin(np.abs(angle_rad[low:high] - value)))
        for low, high, value in zip(first.tolist(), last.tolist(), read_rad, strict=True)
    ]
    return np.array(best, dtype=np.intp)


def draft(seed: int, asked: Asked | None) -> Draft:
    """Draw a case: of a scene where ``asked.rig`` names one, else of a one-joint rig."""
    if asked is not None and asked.rig in SCENES:
        return LeggedDraft(seed, asked)
    return JointDraft(seed, asked)
