"""Walks of a Marvin on MuJoCo whose stance errors have a cause that nobody tells the diagnosis."""

from __future__ import annotations

import enum
import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from bench.blind import Asked
from bench.blind.legged_case import draw_legged
from bench.blind.legged_effects import LEGGED, Where
from bench.blind.scenes import SCENES, Played, play
from bench.motions import WalkPlan
from bench.recording import Recording
from bench.recording.metadata import FORMAT, of_robot
from busemu.tables import Robot

SCENE = "marvin-walk"
LOADS_KG = (0.0, 0.092)  #: source: the thesis's torque experiment, without and with two more cells
SECONDS = 5.0
SEEDS = (0, 3)  #: of the pattern generator's first state, one a recording
#: sizes drawn between these, on a logarithmic scale; the tips' are within what rubber is assumed
#: to have, the joints' extra compliance three to six times that of the file's gear
TIPS_N_M = (500.0, 1500.0)
JOINTS_RAD_NM = (0.2, 0.5)
HEIGHT = "mocap/base_z_m"


class Cause(enum.Enum):
    """What may be wrong in stance."""

    NEITHER = "neither"
    TIPS = "tips"
    JOINTS = "joints"
    BOTH = "both"

    @classmethod
    def of(cls, *, tips: bool, joints: bool) -> Cause:
        """The cause that is made of these."""
        return {
            (False, False): cls.NEITHER,
            (True, False): cls.TIPS,
            (False, True): cls.JOINTS,
            (True, True): cls.BOTH,
        }[tips, joints]

    @property
    def tips(self) -> bool:
        """Whether the tips give."""
        return self in (Cause.TIPS, Cause.BOTH)

    @property
    def joints(self) -> bool:
        """Whether the joints give."""
        return self in (Cause.JOINTS, Cause.BOTH)


@dataclass(frozen=True, slots=True)
class Run:
    """One robot that walks: the truth, and what is written down."""

    number: int
    cause: Cause
    payload_kg: float
    tips_n_m: float
    joints_rad_nm: float
    seed: int

    @property
    def name(self) -> str:
        """Of the run; says nothing of the cause."""
        return f"run-{self.number}"

    def told(self) -> dict[str, Any]:
        """For the key."""
        return {
            "run": self.name,
            "cause": self.cause.value,
            "payload_kg": self.payload_kg,
            "tips_n_m": self.tips_n_m if self.cause.tips else None,
            "joints_rad_nm": self.joints_rad_nm if self.cause.joints else None,
            "seed": self.seed,
        }


def draw_runs(seed: int) -> tuple[Run, ...]:
    """Eight runs, each cause under each load, in an order that the seed draws."""
    random = np.random.default_rng([seed, 41])
    pairs = [(cause, load) for cause in Cause for load in LOADS_KG]
    order = random.permutation(len(pairs))

    def between(ends: tuple[float, float]) -> float:
        return float(math.exp(random.uniform(*np.log(ends))))

    return tuple(
        Run(
            number + 1,
            *pairs[int(which)],
            between(TIPS_N_M),
            between(JOINTS_RAD_NM),
            int(random.integers(1 << 30)),
        )
        for number, which in enumerate(order)
    )


def key_of(runs: tuple[Run, ...], seed: int) -> tuple[str, str]:
    """The key as text, and its SHA-256, which is made known before anything is diagnosed."""
    text = json.dumps({"seed": seed, "runs": [run.told() for run in runs]}, indent=1) + "\n"
    return text, hashlib.sha256(text.encode()).hexdigest()


def record(run: Run) -> Iterator[Recording]:
    """Walk; every robot differs in what is never exactly as believed, too."""
    scene = SCENES[SCENE]
    case = draw_legged(run.seed, Asked(kind="null", rig=SCENE, disguise=False))
    legs = tuple(str(leg["name"]) for leg in scene.robot.document["leg"])
    for seed in SEEDS:
        plan = WalkPlan(seconds=SECONDS, payload_kg=run.payload_kg, seed=seed)
        whole, _ = case.truth(plan)
        where = Where(1, legs)
        if run.cause.tips:
            whole, _ = LEGGED["foot_compliance"].apply(whole, 1.0 / run.tips_n_m, where)
        if run.cause.joints:
            whole, _ = LEGGED["joint_compliance"].apply(whole, run.joints_rad_nm, where)
        played = play(scene, plan, whole.body, whole.electrics)
        yield recording_of(scene.robot, played, f"{run.name}-{seed}", run.payload_kg)


def recording_of(robot: Robot, played: Played, name: str, payload_kg: float) -> Recording:
    """What the robot's program wrote and read, and the height of the trunk beside it."""
    metadata = of_robot(
        robot, name=name, source="simulation", group=name, condition={"payload_kg": payload_kg}
    )
    told = _plain(played.session.recorder.table())
    seen = _plain(played.session.observed.table())
    heights = seen.filter(pc.equal(seen.column("register"), HEIGHT))
    table = pa.concat_tables([told, heights]).sort_by("t_s")
    return Recording.checked(table, {"format": FORMAT, **metadata})


def _plain(table: pa.Table) -> pa.Table:
    """With texts as texts, so that tables with other dictionaries can follow each other."""
    names = [name for name in table.column_names if name != "t_latch_s"]
    texts = ("op", "register")
    return pa.table(
        {n: table.column(n).cast(pa.string()) if n in texts else table.column(n) for n in names}
    )
