"""Gaits searched on a model and walked by the robot itself, so that models can be compared.

The robot is of another engine, which knows no self-collision: that is judged on the model alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from bench.blind.scenes import SCENES, play
from bench.diagnosis.watch import Say
from bench.experiments.locomotion_result import TORQUE_LIMIT
from bench.figures.path import displacement
from bench.gaits.candidate import Candidate
from bench.gaits.ledger import Ledger
from bench.gaits.methods import Method
from bench.gaits.outcome import Job, Outcome
from bench.gaits.search import CHECK_S, CHECKS, Found, GaitSearch, Plan
from bench.gaits.walking import Walker, largest_torque, steady_from_s, torque_sensors
from bench.gaits.walks import Walks
from bench.motions import WalkPlan
from busemu.tables import Robot

from .stance_runs import CAPTURED, SCENE, Run, recording_of, specimen

#: on the model before; the better one goes on from what was found there, as its user would
PLAN = Plan(budget=128, seconds=5.0, methods=(Method.CMA,))
MORE = 64  #: walks on the better model; assumed
PROCESSES = 2
PATH = tuple(f"mocap/base_{name}" for name in ("x_m", "y_m", "yaw_rad"))
LEANING_RAD = math.radians(45.0)  #: so far, and it has fallen; assumed


@dataclass(frozen=True, slots=True)
class Walked:
    """A gait as the robot itself walked it once."""

    speed_m_s: float  #: over whole steps after the start-up, 0 if it fell
    torque_of_stall: float  #: the largest of any joint, from its position error
    torque_joint: str
    fell: bool

    @property
    def allowed(self) -> bool:
        """Whether it stood, within the torque that a search asks for."""
        return not self.fell and self.torque_of_stall < TORQUE_LIMIT


def searched(robot: Robot, folder: Path, say: Say, begin: Candidate | None = None) -> Found:
    """The fastest gait on one model; walks that are in the folder are not made again.

    With a gait to ``begin`` with the search goes on from there, for fewer walks.
    """
    plan = PLAN if begin is None else replace(PLAN, budget=MORE, begin=begin)
    done = 0

    def tell(outcome: Outcome, new: bool) -> None:
        nonlocal done
        done += 1
        if new and done % 8 == 0:
            say(f"searching a gait on {folder.name}: {done} walks")

    with Walks(Walker(robot), PROCESSES) as walks:
        result = GaitSearch(robot, plan, Ledger(folder, robot), walks, tell).run()
    (found,) = result.found
    return found


def really(run: Run, candidate: Candidate, seed: int) -> Walked:
    """One walk of a gait by the robot itself, for as long as a search checks a gait."""
    plan = WalkPlan(CHECK_S, v_left=candidate.v_left, v_right=candidate.v_right, seed=seed)
    scene = SCENES[SCENE]
    robot = candidate.on(scene.robot)
    whole = specimen(run, plan)
    played = play(scene, plan, whole.body, whole.electrics, robot)
    recording = recording_of(robot, played, "gait", 0.0, (*PATH, *CAPTURED))
    end_s = played.session.clock.now_s()
    span = (end_s - plan.seconds, end_s)
    seen = [recording.observed(name) for name in PATH]
    from_s = steady_from_s(Job(candidate, plan.seconds, seed), span)
    inside = seen[0].t_sample_s >= from_s
    lean = max(float(np.abs(recording.observed(name).value).max()) for name in CAPTURED)
    way = displacement(seen[0].t_sample_s[inside], *(one.value[inside] for one in seen))
    joint, torque = largest_torque(robot, torque_sensors(robot), recording, span)
    fell = lean > LEANING_RAD
    return Walked(0.0 if fell else way.speed_m_s, torque, joint, fell)


def told(run: Run, found: Found, say: Say) -> dict[str, Any]:
    """A gait on its own model and as the robot walks it, for ``loop.json``; empty if none."""
    gait = found.candidate
    if gait is None:
        return {}
    walks = []
    for seed in range(CHECKS):
        say(f"the robot itself walks the gait found, {seed + 1} of {CHECKS}")
        walks.append(really(run, gait, seed))
    return {
        "gait": asdict(gait),
        "model": {
            "speed_m_s": found.speed_m_s,
            "torque_of_stall": max(c.torque_of_stall for c in found.checks),
        },
        "robot": {
            "speed_m_s": fmean(one.speed_m_s for one in walks),
            "torque_of_stall": max(one.torque_of_stall for one in walks),
            "torque_joint": max(walks, key=lambda one: one.torque_of_stall).torque_joint,
            "allowed": sum(one.allowed for one in walks),
            "of": len(walks),
        },
    }


def lines(gaits: dict[str, dict[str, Any]]) -> Sequence[str]:
    """The result in words."""
    said = []
    for model, one in gaits.items():
        if not one:
            said.append(f"gait search on the model {model}: none stands its checks")
            continue
        own, real = one["model"], one["robot"]
        said.append(
            f"gait found on the model {model}: {1e3 * own['speed_m_s']:.0f} mm/s there, "
            f"{1e3 * real['speed_m_s']:.0f} mm/s by the robot, which needs "
            f"{real['torque_of_stall']:.2f} of stall ({real['allowed']} of {real['of']} walks "
            f"within {TORQUE_LIMIT:g})"
        )
    return said
