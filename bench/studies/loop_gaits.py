"""Gaits searched on a model and walked by the robot itself, so that models can be compared.

A model that shows less torque than the robot needs cannot be trusted up to the limit. How much less
is known from the walks that were recorded, and each model is searched so far below it.

The robot is of another engine, which knows no self-collision: that is judged on the model alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from operator import itemgetter
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
from bench.gaits.walking import Walker, largest_torques, steady_from_s, torque_sensors
from bench.gaits.walks import Walks
from bench.motions import WalkPlan
from bench.recording import Recording, joint_track
from busemu.tables import Robot

from .stance_runs import CAPTURED, SCENE, Run, recording_of, specimen

#: on the model before; it goes on from what it found, and then both do, for so many walks; assumed
PLAN = Plan(budget=128, seconds=5.0, methods=(Method.CMA,))
MORE = 256
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


def short_of_torque(robot: Robot, walks: Sequence[tuple[Recording, Recording, float]]) -> float:
    """How much less torque a model shows than the robot itself, as a share of the stall torque.

    Of every walk what the robot and what the model recorded, and its length [s]. The most that any
    joint's largest torque is short in any walk; 0 if none is.
    """
    sensors = torque_sensors(robot)
    short = [0.0]
    for real, modelled, seconds in walks:
        largest = []
        for recording in (real, modelled):
            read = (joint_track(recording, m.joint, robot) for m in robot.servos)
            end_s = max(track.position_t_s[-1] for track in read)
            largest.append(largest_torques(robot, sensors, recording, (end_s - seconds, end_s)))
        short += [largest[0][joint] - largest[1][joint] for joint in sensors]
    return max(short)


def searched(
    robot: Robot, short: float, folder: Path, say: Say, begin: Candidate | None = None
) -> Found:
    """The fastest gait on one model that is ``short`` of torque (:func:`short_of_torque`).

    Walks that are in the folder are not made again. With a gait to ``begin`` with the search goes
    on from there.
    """
    plan = PLAN if begin is None else replace(PLAN, budget=MORE, begin=begin)
    done = 0

    def tell(outcome: Outcome, new: bool) -> None:
        nonlocal done
        done += 1
        if new and done % 8 == 0:
            say(f"searching a gait on {folder.name}: {done} walks")

    with Walks(Walker(robot), PROCESSES) as walks:
        ledger = Ledger(folder, robot, TORQUE_LIMIT - short)
        result = GaitSearch(robot, plan, ledger, walks, tell).run()
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
    largest = largest_torques(robot, torque_sensors(robot), recording, span)
    joint, torque = max(largest.items(), key=itemgetter(1))
    fell = lean > LEANING_RAD
    return Walked(0.0 if fell else way.speed_m_s, torque, joint, fell)


def told(run: Run, found: Found, short: float, say: Say) -> dict[str, Any]:
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
            "short_of_torque": short,
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
            f"gait found on the model {model}, searched {own['short_of_torque']:.2f} of stall "
            f"below the limit, as it was short of torque: {1e3 * own['speed_m_s']:.0f} mm/s there, "
            f"{1e3 * real['speed_m_s']:.0f} mm/s by the robot, which needs "
            f"{real['torque_of_stall']:.2f} of stall ({real['allowed']} of {real['of']} walks "
            f"within {TORQUE_LIMIT:g})"
        )
    return said
