"""Compiled bodies on a free trunk: against PyBullet, against their energy, against conservation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from busemu.tables import Robot
from sim.floating.arrays import FREE, Motion, Tree, motion, tree, work
from sim.floating.dynamics import bias_forces, mass_matrix, place_bodies
from sim.floating.rollout import inverse_mass, step
from sim.robot import read_physics
from sim.tree import GRAVITY_M_S2, Payload, PhysicalRobot
from sim.world import World

LEVEL = (0.0, 0.0, 0.0, 1.0)
FAR_M = 100.0  #: above the ground


def uneven(robot: Robot) -> PhysicalRobot:
    """A robot that is like itself on no side."""
    physical = read_physics(robot)
    return replace(physical, payload=Payload("leg2.tibia", (0.03, 0.01, -0.02), 0.1, 2e-5))


def somewhere(of: Tree, seed: int, pace: float = 1.0) -> Motion:
    random = np.random.default_rng(seed)
    found = motion(of)
    found.turned[:] = np.linalg.qr(random.standard_normal((3, 3)))[0]
    if np.linalg.det(found.turned) < 0.0:
        found.turned[:, 0] *= -1.0
    found.origin[:] = 0.0, 0.0, FAR_M
    found.angle[1:] = random.uniform(-0.5, 0.5, len(of.parent) - 1)
    found.pace[:] = pace * random.standard_normal(len(found.pace))
    return found


def moving(of: Tree, now: Motion) -> tuple[np.ndarray, np.ndarray]:
    """The whole mass matrix, and momentum: turning about the origin, and linear."""
    room = work(of)
    place_bodies(of, now, room)
    mass_matrix(of, room)
    lower = np.tril(room.mass)
    mass = lower + np.tril(lower, -1).T
    return mass, (mass @ now.pace)[:FREE]


@pytest.mark.parametrize("held", [False, True])
def test_joints_are_as_hard_to_move_as_in_pybullet(robot: Robot, held: bool) -> None:
    physical = uneven(robot)
    world = World(physical, step_s=0.001, held=held)
    random = np.random.default_rng(3)
    for _ in range(5):
        angles = {j.name: float(random.uniform(j.lower_rad, j.upper_rad)) for j in physical.joints}
        world.place((0.0, 0.0, 1.0), LEVEL, angles)
        theirs, ours = world.inverse_mass(), inverse_mass(physical, angles, held=held)
        assert np.abs(ours - theirs).max() < 1e-4 * np.abs(theirs).max()
    world.close()


def test_gravity_pulls_every_joint_down_its_energy(robot: Robot) -> None:
    of = tree(uneven(robot))
    now, room = somewhere(of, 5, pace=0.0), work(of)
    place_bodies(of, now, room)
    bias_forces(of, now, room)

    def energy(joint: int, by: float) -> float:
        now.angle[joint] += by
        place_bodies(of, now, room)
        now.angle[joint] -= by
        return float(-room.inertias[:, 1:4].sum(axis=0) @ of.gravity)

    for joint in range(1, len(of.parent)):
        slope = (energy(joint, 1e-5) - energy(joint, -1e-5)) / 2e-5
        assert room.push[FREE + joint - 1] == pytest.approx(slope, abs=1e-8)


def test_what_flies_keeps_its_momentum_and_its_energy_the_better_the_shorter_the_step(
    robot: Robot,
) -> None:
    of = tree(uneven(robot))._replace(gravity=np.zeros(3))
    none = np.zeros(len(of.parent) - 1)

    def lost(step_s: float) -> tuple[float, float]:
        now, room = somewhere(of, 7), work(of)
        mass, before = moving(of, now)
        energy, origin = now.pace @ mass @ now.pace, now.origin.copy()
        for _ in range(round(0.05 / step_s)):
            step(of, now, room, none, step_s, True)
        mass, after = moving(of, now)
        after[:3] += np.cross(now.origin - origin, after[3:])
        turned = np.abs(after - before).max() / np.abs(before).max()
        return float(turned), abs(float(now.pace @ mass @ now.pace / energy) - 1.0)

    coarse, fine = lost(1e-3), lost(1e-4)
    assert max(coarse) < 0.05
    assert 7.0 < coarse[0] / fine[0] < 13.0
    assert 7.0 < coarse[1] / fine[1] < 13.0


def test_what_falls_falls_freely(robot: Robot) -> None:
    of = tree(read_physics(robot))
    now, room, none = somewhere(of, 9, pace=0.0), work(of), np.zeros(len(of.parent) - 1)
    for _ in range(100):
        step(of, now, room, none, 1e-3, True)
    assert now.pace[3:6] == pytest.approx([0.0, 0.0, -0.1 * GRAVITY_M_S2], abs=1e-9)
    assert now.pace[:3] == pytest.approx(np.zeros(3), abs=1e-9)


def test_a_held_trunk_stays(robot: Robot) -> None:
    of = tree(read_physics(robot))
    now, room, none = somewhere(of, 11, pace=0.0), work(of), np.zeros(len(of.parent) - 1)
    was = now.origin.copy(), now.turned.copy(), now.angle.copy()
    for _ in range(20):
        step(of, now, room, none, 1e-3, False)
    assert (now.origin == was[0]).all()
    assert now.turned == pytest.approx(was[1], abs=1e-12)
    assert np.abs(now.angle - was[2]).max() > 1e-3
