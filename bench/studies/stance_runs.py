"""Walks of a Marvin on MuJoCo whose stance errors have a cause that nobody tells the diagnosis."""

from __future__ import annotations

import enum
import hashlib
import json
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from bench.blind import Asked
from bench.blind.legged_case import draw_legged
from bench.blind.legged_effects import LEGGED, Where, Whole
from bench.blind.scenes import SCENES, Played, play
from bench.diagnosis.robot.replay import HEIGHT, LEANS
from bench.motions import WalkPlan
from bench.recording import Recording
from bench.recording.metadata import FORMAT, of_robot
from busemu.tables import Robot

SCENE = "marvin-walk"
LOADS_KG = (0.0, 0.092)  #: source: the thesis's torque experiment, without and with two more cells
SECONDS = 10.0  #: six steady cycles or so; walks of 5 s have fewer than three
SEEDS = (0, 3)  #: of the pattern generator's first state, one a recording under the run's load
OTHER_LOAD = "other-load"  #: the recording of the same robot under the other load
BARE = "tips-off"  #: recordings of the same robot without its tips
#: sizes drawn between these, on a logarithmic scale; the tips' are within what rubber is assumed
#: to have, the joints' extra compliance three to six times that of the file's gear
TIPS_N_M = (500.0, 1500.0)
JOINTS_RAD_NM = (0.2, 0.5)
IMU, CAPTURED = LEANS  #: how the trunk leans, by an inertial sensor on it or by an observer


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

    def walks(self, *, bare: bool = False) -> tuple[tuple[str, WalkPlan], ...]:
        """Names of the recordings, and what was walked: twice as drawn, then with other weight.

        ``bare``: with the tips taken off.
        """
        name = f"{self.name}-{BARE}" if bare else self.name
        own = [
            (f"{name}-{seed}", WalkPlan(SECONDS, payload_kg=self.payload_kg, seed=seed))
            for seed in SEEDS
        ]
        (other,) = (load for load in LOADS_KG if load != self.payload_kg)
        more = WalkPlan(SECONDS, payload_kg=other, seed=SEEDS[0])
        return (*own, (f"{name}-{OTHER_LOAD}", more))

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


def specimen(run: Run, plan: WalkPlan, *, bare: bool = False) -> Whole:
    """The robot of a run: every one differs in what is never exactly as believed, too.

    ``bare``: with its tips taken off, on feet that are as long and do not give.
    """
    case = draw_legged(run.seed, Asked(kind="null", rig=SCENE, disguise=False))
    whole, _ = case.truth(plan)
    where = Where(1, tuple(str(leg["name"]) for leg in SCENES[SCENE].robot.document["leg"]))
    if run.cause.tips and not bare:
        whole, _ = LEGGED["foot_compliance"].apply(whole, 1.0 / run.tips_n_m, where)
    if run.cause.joints:
        whole, _ = LEGGED["joint_compliance"].apply(whole, run.joints_rad_nm, where)
    return whole


def record(run: Run, plan: WalkPlan, name: str, *, bare: bool = False) -> Recording:
    """Walk."""
    scene = SCENES[SCENE]
    whole = specimen(run, plan, bare=bare)
    played = play(scene, plan, whole.body, whole.electrics)
    return recording_of(scene.robot, played, name, plan.payload_kg, (HEIGHT, *IMU))


def recording_of(
    robot: Robot, played: Played, name: str, payload_kg: float, watched: Sequence[str] = (HEIGHT,)
) -> Recording:
    """What the robot's program wrote and read, and what was watched of its trunk beside it."""
    metadata = of_robot(
        robot, name=name, source="simulation", group=name, condition={"payload_kg": payload_kg}
    )
    told = _plain(played.session.recorder.table())
    seen = _plain(played.session.observed.table())
    beside = seen.filter(pc.is_in(seen.column("register"), pa.array(watched)))
    table = pa.concat_tables([told, beside]).sort_by("t_s")
    return Recording.checked(table, {"format": FORMAT, **metadata})


def only(recording: Recording, beside: Collection[str]) -> Recording:
    """The recording without what was watched beside the servos, but for these registers."""
    register = recording.table.column("register").cast(pa.string())
    own = pc.invert(pc.match_substring(register, "/"))
    told = pc.or_(own, pc.is_in(register, pa.array(sorted(beside), pa.string())))
    return Recording.checked(recording.table.filter(told), recording.metadata)


def _plain(table: pa.Table) -> pa.Table:
    """With texts as texts, so that tables with other dictionaries can follow each other."""
    names = [name for name in table.column_names if name != "t_latch_s"]
    texts = ("op", "register")
    return pa.table(
        {n: table.column(n).cast(pa.string()) if n in texts else table.column(n) for n in names}
    )
