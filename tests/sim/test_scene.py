"""What is around a robot: read from its file, and felt."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pybullet
import pytest
from sim_rigs import changed, hold, stand

from busemu.assemble import plants
from busemu.tables import RobotError, load_robot
from sim.model import read_model
from sim.one_joint import one_joint_load
from sim.robot import read_physics
from sim.scene import Push, Scene, Slab, read_scene
from sim.tree import GRAVITY_M_S2, Ground, Payload
from sim.world import BulletPlant, World

Make = Callable[..., BulletPlant]

WHOLE = """
format = "busemu-world/1"
[ground]
friction = 0.8
stiffness_n_m = 5000.0
damping_n_s_m = 10.0
pitch_rad = 0.1
[payload]
mass_kg = 0.2
at_m = [0.0, 0.0, 0.03]
[[slab]]
at_m = [0.0, 0.5]
size_m = [1.0, 0.2]
height_m = 0.01
friction = 0.3
[[push]]
at_s = 3.0
for_s = 0.1
force_n = [2.0, 0.0, 0.0]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "world.toml"
    path.write_text(text, "utf-8")
    return path


def test_a_file_is_read_as_it_is_written(tmp_path: Path) -> None:
    assert read_scene(written(tmp_path, WHOLE)) == Scene(
        ground=Ground(0.8, 5000.0, 10.0, 0.1, 0.0),
        slabs=(Slab((0.0, 0.5), (1.0, 0.2), 0.01, 0.0, Ground(0.3)),),
        pushes=(Push(3.0, 0.1, (2.0, 0.0, 0.0), "trunk", (0.0, 0.0, 0.0)),),
        payload=Payload(None, (0.0, 0.0, 0.03), 0.2),
    )


REFUSED = {
    "no format": ("[ground]", 'format = "busemu-world/1"'),
    "unknown section": ('format = "busemu-world/1"\n[sky]', "unknown section sky"),
    "misspelt": ('format = "busemu-world/1"\n[ground]\nfricton = 1.0', "fricton"),
    "too steep": ('format = "busemu-world/1"\n[ground]\npitch_rad = 1.2', "-0.7 to 0.7 rad"),
    "damper alone": (
        'format = "busemu-world/1"\n[ground]\ndamping_n_s_m = 1.0',
        "needs a stiffness_n_m",
    ),
    "no force": ('format = "busemu-world/1"\n[[push]]\nat_s = 1\nfor_s = 1', "3 numbers in N"),
    "not toml": ("ground", "not a TOML file"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_worlds_that_cannot_be_are_refused_with_one_line(case: str, tmp_path: Path) -> None:
    text, says = REFUSED[case]
    with pytest.raises(RobotError) as caught:
        read_scene(written(tmp_path, text))
    assert says in str(caught.value)
    assert "world.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="cannot be read"):
        read_scene(tmp_path / "none.toml")


def test_the_plant_named_bullet_takes_a_world_and_the_ideal_one_refuses_it(tmp_path: Path) -> None:
    path = written(tmp_path, WHOLE)
    robot = load_robot("marvin")
    plant = plants()["bullet"](robot, world=path)
    assert isinstance(plant, BulletPlant)
    assert plant.robot.ground == read_scene(path).ground
    plant.close()
    with pytest.raises(RobotError, match="ideal knows no world"):
        plants()["ideal"](robot, world=path)


def test_an_empty_scene_changes_no_bit(make: Make) -> None:
    robot = load_robot("marvin")
    bare, empty = make(robot), make(robot, scene=Scene())
    for plant in (bare, empty):
        hold(plant, robot, plant.robot.neutral_rad)
        plant.advance(0.5)
    assert bare.observe() == empty.observe()


def test_a_push_gives_its_impulse() -> None:
    robot = load_robot("marvin")
    force = (0.5, -0.3, 12.0)
    push = Push(0.02, 0.05, force, "trunk", (0.0, 0.0, 0.0))
    physical = Scene(pushes=(push,)).around(read_physics(robot))
    world = World(physical, step_s=0.001, pushes=(push,))
    world.place((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0), {})
    for _ in range(100):
        world.step(np.zeros(18))
    momentum = physical.mass_kg * centre_velocity(world)
    world.close()
    gravity = np.array([0.0, 0.0, -GRAVITY_M_S2 * 0.1 * physical.mass_kg])
    assert momentum == pytest.approx(np.array(force) * 0.05 + gravity, abs=1e-3)


def centre_velocity(world: World) -> np.ndarray:
    on = {"physicsClientId": world._client}
    links = range(pybullet.getNumJoints(world._body, **on))
    masses = np.array([pybullet.getDynamicsInfo(world._body, i, **on)[0] for i in (-1, *links)])
    speeds = [pybullet.getBaseVelocity(world._body, **on)[0]]
    speeds += [pybullet.getLinkState(world._body, i, 1, 1, **on)[6] for i in links]
    mean: np.ndarray = masses @ np.array(speeds) / masses.sum()
    return mean


def test_a_rigs_body_can_be_pushed(make: Make) -> None:
    robot = load_robot("pendulum")
    held = make(robot, scene=Scene(pushes=(Push(0.1, 5.0, (0.6, 0, 0), "arm", (0, 0, -0.12)),)))
    held.advance(4.0)
    # hanging at rest: the torque of the push is at most gravity's and the friction's
    assert held.observe()["rig/arm_rad"] < -0.01
    with pytest.raises(RobotError, match="no such body"):
        make(robot, scene=Scene(pushes=(Push(0.1, 1.0, (1, 0, 0), "trunk", (0, 0, 0)),)))


def test_a_robot_starts_on_the_slab_it_stands_on(make: Make) -> None:
    robot = load_robot("marvin")
    flat = make(robot)
    slab = Slab((0.0, 0.0), (1.0, 1.0), 0.05, 0.3, Ground())
    raised = make(robot, scene=Scene(slabs=(slab,)))
    for plant in (flat, raised):
        stand(plant, robot, 3.0)
    lift = raised.observe()["mocap/base_z_m"] - flat.observe()["mocap/base_z_m"]
    assert lift == pytest.approx(0.05, abs=5e-4)


@pytest.mark.parametrize("far", [False, True])
def test_a_slippery_patch_lets_slide_only_who_stands_on_it(make: Make, far: bool) -> None:
    robot = load_robot("marvin")
    friction = robot.document["contact"]["friction"]["value"]
    place = (3.0, 0.0) if far else (0.0, 0.0)
    patch = Slab(place, (2.0, 2.0), 0.0002, 0.0, Ground(friction=0.3))
    slope = Ground(roll_rad=math.atan(0.6 * friction))
    plant = make(robot, scene=Scene(ground=slope, slabs=(patch,)))
    stand(plant, robot, 3.0)
    assert (plant.observe()["mocap/base_x_m"] > 0.5) != far


def test_a_soft_slab_gives_way_and_the_ground_beside_it_does_not(make: Make) -> None:
    robot = load_robot("marvin")
    mat = Slab((1.0, 0.0), (2.0, 4.0), 0.02, 0.0, Ground(1.0, 1000.0, 5.0))  # right half only
    hard = Slab((-1.0, 0.0), (2.0, 4.0), 0.02, 0.0, Ground())
    plant = make(robot, scene=Scene(slabs=(mat, hard)))
    stand(plant, robot, 4.0)
    seen, feet = plant.observe(), plant.world.feet()
    for leg in plant.robot.legs:
        depth = leg.foot.radius_m + 0.02 - feet[leg.name][2]
        soft = leg.x_m > 0.0
        wanted = seen[f"contact/{leg.name}_n"] / 1000.0 if soft else 0.0
        assert depth == pytest.approx(wanted, abs=3e-5)


def test_a_payload_rests_on_the_feet(make: Make) -> None:
    robot = load_robot("marvin")
    plant = make(robot, scene=Scene(payload=Payload(None, (0.0, 0.0, 0.02), 0.15)))
    bare = make(robot).robot.mass_kg
    assert plant.robot.mass_kg == pytest.approx(bare + 0.15)
    stand(plant, robot, 4.0)
    loads = [
        sum(plant.observe()[f"contact/{leg.name}_n"] for leg in plant.robot.legs)
        for _ in range(50)
        if plant.advance(plant._now_s + 0.001) is None
    ]
    assert np.mean(loads) == pytest.approx((bare + 0.15) * GRAVITY_M_S2, rel=0.01)


def test_a_rig_has_no_slabs(make: Make) -> None:
    slab = Slab((0.0, 0.0), (1.0, 1.0), 0.05, 0.0, Ground())
    with pytest.raises(RobotError, match="fixed base"):
        make(load_robot("pendulum"), scene=Scene(slabs=(slab,)))


def test_a_rig_carries_the_payload_of_its_world_where_its_own_would_be(make: Make) -> None:
    lone = {"value": [6e-7, 1.2e-6, 6e-7], "source": "a horn alone"}
    robot = changed(load_robot("mx64-bench"), "body", 0, "inertia_kg_m2", to=lone)
    with pytest.raises(RobotError, match="or hang more on the joint"):
        make(robot)
    make(load_robot("mx64-bench"))
    plant = make(robot, scene=Scene(payload=Payload(None, (0.0, 0.0, -0.01), 0.3)))
    own = read_model(robot).payload
    assert own is not None
    assert one_joint_load(plant.robot).gravity_nm == pytest.approx(
        0.3 * GRAVITY_M_S2 * (0.01 - own.at_m[2])
    )


def test_a_payload_on_a_rig_that_has_no_place_for_one_is_refused(make: Make) -> None:
    robot = changed(load_robot("pendulum"), "payload", to=None)
    with pytest.raises(RobotError, match=r"mass_kg = 0\.3 kg: pendulum has no \[payload\]"):
        make(robot, scene=Scene(payload=Payload(None, (0.0, 0.0, 0.0), 0.3)))


def test_a_push_on_a_body_that_is_not_there_says_which_there_are(make: Make) -> None:
    push = Push(1.0, 0.1, (1.0, 0.0, 0.0), "trunk", (0.0, 0.0, 0.0))
    with pytest.raises(RobotError, match=r"body 'trunk': pendulum has no such body, but arm"):
        make(load_robot("pendulum"), scene=Scene(pushes=(push,)))
