"""Walks of a simulated Marvin that the tests of whole robots look at."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.nuisances import nuisances
from bench.diagnosis.robot.replay import Course, Jitter, course, play
from bench.recording import Recording
from bench.running import Steering, in_process, walk_in
from busemu.tables import Robot, load_robot
from busemu.timing import load_profile
from sim.model import read_model
from sim.tree import PhysicalRobot
from sim.world import BulletPlant


@cache
def marvin() -> Robot:
    return load_robot("marvin")


@cache
def believed() -> PhysicalRobot:
    return read_model(marvin())


@cache
def recorded_walk(name: str = "marvin") -> Recording:
    """A short walk over the emulated bus, as a robot's own program records it."""
    robot = load_robot(name)
    plant = BulletPlant(robot)
    session = in_process(robot, plant, load_profile(robot.timing), observe_every_s=0.02)
    walk_in(session, Steering(seconds=4.5))
    plant.close()
    return session.recording("walk-1", "walk")


@cache
def walked() -> Course:
    return course(recorded_walk(), marvin())


def but(*words: str) -> set[str]:
    """The first words of all tolerances but some, which a model that needs few takes for known."""
    return {n.name.split()[0] for n in nuisances(believed(), 0.005)} - {*words, "reading"}


def walked_with(effects: dict[str, float], seed: int) -> Course:
    """The same walk of a robot with effects (by knob), from a slightly other start."""
    robot = believed()
    known = placed_effects(robot)
    for name, z in effects.items():
        robot = known[name].apply(robot, known[name].knob.value(z))
    return walked_by(robot, seed)


def walked_by(robot: PhysicalRobot, seed: int, told: Course | None = None) -> Course:
    """The same walk of another robot, from a slightly other start."""
    told = told or walked()
    track = play(robot, told, Jitter(seed))
    seen = tuple(
        np.round(track.at(j, t) / told.quantum_rad) * told.quantum_rad
        for j, t in enumerate(told.sample_s)
    )
    return replace(told, name=f"walk-{seed}", group=f"walk-{seed}", position_rad=seen)
