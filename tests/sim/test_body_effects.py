"""Effects of bodies and contacts: nothing when off, and what their equations say when on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pybullet
import pytest
from sim_rigs import changed, hold, stand, with_effect

from busemu.tables import Robot, load_robot
from sim.effects import Effect, Group, catalogue
from sim.model import read_model
from sim.one_joint import one_joint_load
from sim.robot import read_physics
from sim.tree import GRAVITY_M_S2
from sim.world import BulletPlant, World

Make = Callable[..., BulletPlant]
BODY = [effect for effect in catalogue().values() if effect.group is Group.BODY]
NAMES = {
    "link_mass", "payload", "com_offset", "foot_compliance", "foot_slip", "ground_compliance",
    "ground_tilt", "leg_geometry",
}  # fmt: skip


def trace(plant: BulletPlant, robot: Robot) -> list[Any]:
    seen = []
    for part, posture in enumerate(
        (plant.robot.neutral_rad, {"coxa": 0.2, "femur": 0.9, "tibia": -1.8})
    ):
        hold(plant, robot, posture)
        for step in range(60):
            plant.advance(0.3 * part + 0.005 * (step + 1))
            seen.append((plant.observe(), plant.sample(3)))
    return seen


def test_the_catalogue_has_the_contracts_bodies_and_contacts() -> None:
    assert {effect.name for effect in BODY} == NAMES


@pytest.mark.parametrize("effect", BODY, ids=lambda effect: effect.name)
def test_an_effect_that_is_off_changes_no_bit(make: Make, effect: Effect) -> None:
    robot = load_robot("marvin")
    off = with_effect(robot, effect.name, [], **effect.off)
    assert read_model(off) == read_physics(robot)
    assert trace(make(off), off) == trace(make(robot), robot)


@pytest.mark.parametrize("effect", BODY, ids=lambda effect: effect.name)
def test_an_effect_of_typical_size_shows(make: Make, effect: Effect) -> None:
    robot = load_robot("marvin")
    typical = {key: value for key, value in effect.typical.items() if math.isfinite(value)}
    on = with_effect(robot, effect.name, [], **typical)
    assert trace(make(on), on) != trace(make(robot), robot)


@pytest.mark.parametrize("effect", BODY, ids=lambda effect: effect.name)
def test_typical_and_off_are_parameters_an_effect_accepts(effect: Effect) -> None:
    for parameter in effect.parameters:
        parameter.check(parameter.typical)
        parameter.check(parameter.off)


def settled(make: Make, robot: Robot, **options: Any) -> tuple[BulletPlant, Mapping[str, float]]:
    """Standing at neutral for 4 s, then what is seen, averaged over 100 steps."""
    plant = make(robot, **options)
    stand(plant, robot, 4.0)
    rows: list[Mapping[str, float]] = []
    for step in range(100):
        plant.advance(4.0 + 0.001 * (step + 1))
        rows.append(plant.observe())
    return plant, {
        key: float(np.mean([row[key] for row in rows]))
        for key in rows[0]
        if all(key in row for row in rows)
    }


SLOP_M = 1.0e-5  #: what the engine lets every contact sink in before it pushes, soft or not


@pytest.mark.parametrize("stiffness", [500.0, 3000.0, 30000.0])
@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_soft_feet_sink_in_by_load_over_stiffness(
    robot: Robot, make: Make, stiffness: float, damping: float
) -> None:
    soft = with_effect(robot, "foot_compliance", [], stiffness_n_m=stiffness, damping_n_s_m=damping)
    plant, seen = settled(make, soft)
    for leg in plant.robot.legs:
        depth = leg.foot.radius_m - plant.world.feet()[leg.name][2]
        assert depth - SLOP_M == pytest.approx(seen[f"contact/{leg.name}_n"] / stiffness, rel=0.02)


def test_one_soft_foot_sinks_in_and_the_others_do_not(make: Make) -> None:
    robot = load_robot("marvin")
    plant, _ = settled(make, with_effect(robot, "foot_compliance", ["leg3"], stiffness_n_m=500.0))
    feet = plant.world.feet()
    for leg in plant.robot.legs:
        depth = leg.foot.radius_m - feet[leg.name][2]
        assert (depth > 1e-3) == (leg.name == "leg3")


def test_soft_feet_on_soft_ground_are_springs_in_series(make: Make) -> None:
    robot = load_robot("marvin")
    both = with_effect(robot, "foot_compliance", [], stiffness_n_m=2000.0)
    both = with_effect(both, "ground_compliance", [], stiffness_n_m=1000.0)
    plant, seen = settled(make, both)
    for leg in plant.robot.legs:
        depth = leg.foot.radius_m - plant.world.feet()[leg.name][2]
        load = seen[f"contact/{leg.name}_n"]
        assert depth - SLOP_M == pytest.approx(load / 2000.0 + load / 1000.0, rel=0.02)


def test_a_soft_foot_rings_at_the_frequency_of_its_spring() -> None:
    robot = load_robot("marvin")
    stiffness = 1000.0
    soft = read_model(with_effect(robot, "foot_compliance", [], stiffness_n_m=stiffness))
    world = World(soft, step_s=1e-4)
    masses = soft.mass_kg
    pybullet.setJointMotorControlArray(
        world._body,
        range(18),
        pybullet.POSITION_CONTROL,
        targetPositions=[soft.posture(soft.neutral_rad)[j.name] for j in soft.joints],
        forces=[1e3] * 18,
        physicsClientId=world._client,
    )
    height = soft.height_m(soft.neutral_rad)
    world.place(
        (0.0, 0.0, height - masses * GRAVITY_M_S2 / (6.0 * stiffness) - 5e-4),
        (0.0, 0.0, 0.0, 1.0),
        soft.posture(soft.neutral_rad),
    )
    heights = []
    for _ in range(2000):
        world.step_bare()
        heights.append(world.base()[0][2])
    world.close()
    around = np.array(heights) - np.mean(heights)
    crossings = np.flatnonzero(np.diff(np.sign(around)))
    period = 2.0 * float(np.mean(np.diff(crossings))) * 1e-4
    wanted = 2.0 * math.pi * math.sqrt(masses / (6.0 * stiffness))
    assert period == pytest.approx(wanted, rel=0.03)


@pytest.mark.parametrize(("scale", "slides"), [(0.8, True), (1.25, False)])
def test_worn_feet_slide_on_a_slope_where_friction_ends(
    make: Make, scale: float, slides: bool
) -> None:
    robot = load_robot("marvin")
    friction = robot.document["contact"]["friction"]["value"]
    tilted = with_effect(robot, "ground_tilt", [], roll_rad=math.atan(friction))
    plant = make(with_effect(tilted, "foot_slip", [], scale=scale))
    stand(plant, robot, 3.0)
    before = plant.observe()["mocap/base_x_m"]
    plant.advance(4.0)
    moved = plant.observe()["mocap/base_x_m"] - before
    assert (moved > 0.05) == slides


def test_on_ground_that_rises_forward_the_load_moves_to_the_rear(make: Make) -> None:
    """Plumb below the centre of mass, by its height times the slope."""
    robot = load_robot("marvin")
    plant, seen = settled(make, with_effect(robot, "ground_tilt", [], pitch_rad=0.15))
    feet = plant.world.feet()
    loads = {leg: seen[f"contact/{leg}_n"] for leg in feet}
    whole = sum(loads.values())
    pressure_y = sum(loads[leg] * place[1] for leg, place in feet.items()) / whole
    _, centre_y, centre_z = centre_of_mass(plant.world)
    assert pressure_y - centre_y == pytest.approx(-centre_z * math.tan(0.15), rel=0.02)
    assert whole == pytest.approx(plant_weight(robot) * math.cos(0.15), rel=0.01)


def centre_of_mass(world: World) -> np.ndarray:
    on = {"physicsClientId": world._client}
    links = range(-1, pybullet.getNumJoints(world._body, **on))
    masses = np.array([pybullet.getDynamicsInfo(world._body, i, **on)[0] for i in links])
    places = [pybullet.getBasePositionAndOrientation(world._body, **on)[0]]
    places += [pybullet.getLinkState(world._body, i, **on)[0] for i in links if i >= 0]
    centre: np.ndarray = masses @ np.array(places) / masses.sum()
    return centre


def plant_weight(robot: Robot) -> float:
    return read_physics(robot).mass_kg * GRAVITY_M_S2


def test_a_stand_that_leans_moves_where_a_pendulum_hangs() -> None:
    rig = load_robot("pendulum")
    level = one_joint_load(read_physics(rig))
    leaning = one_joint_load(read_model(with_effect(rig, "ground_tilt", [], roll_rad=0.05)))
    # the stand falls towards +x: seen from it, the arm hangs towards +x, at an angle about -y
    assert leaning.centre_rad == pytest.approx(-0.05)
    assert leaning.gravity_nm == pytest.approx(level.gravity_nm)


def test_a_payload_presses_on_the_feet(make: Make) -> None:
    robot = load_robot("marvin")
    loaded = with_effect(robot, "payload", [], mass_kg=0.2, x_m=0.03)
    plant, seen = settled(make, loaded)
    assert plant.robot.mass_kg == pytest.approx(read_physics(robot).mass_kg + 0.2)
    whole = sum(value for key, value in seen.items() if key.startswith("contact/leg"))
    assert whole == pytest.approx(plant_weight(robot) + 0.2 * GRAVITY_M_S2, rel=0.01)
    right = sum(seen[f"contact/{leg}_n"] for leg in ("leg2", "leg4", "leg6"))
    assert right > 0.5 * whole + 0.2


def test_a_rigs_payload_sits_where_its_file_says() -> None:
    rig = load_robot("pendulum")
    base = one_joint_load(read_physics(rig))
    more = one_joint_load(read_model(with_effect(rig, "payload", [], mass_kg=0.1, z_m=-0.02)))
    down = -rig.document["payload"]["at_m"]["value"][2] + 0.02
    assert more.gravity_nm - base.gravity_nm == pytest.approx(0.1 * GRAVITY_M_S2 * down)
    assert more.inertia_kg_m2 - base.inertia_kg_m2 == pytest.approx(0.1 * down**2)


def test_link_mass_scales_what_it_names() -> None:
    robot = load_robot("marvin")
    base, heavy = (
        read_physics(robot),
        read_model(with_effect(robot, "link_mass", ["leg2.tibia", "trunk"], scale=1.2)),
    )
    for old, new in zip(base.bodies, heavy.bodies, strict=True):
        scale = 1.2 if new.name == "leg2.tibia" else 1.0
        assert new.mass.mass_kg == pytest.approx(scale * old.mass.mass_kg)
        assert new.mass.tensor_kg_m2 == pytest.approx(scale * old.mass.tensor_kg_m2)
        assert new.mass.centre_m == old.mass.centre_m
    assert heavy.trunk_mass.mass_kg == pytest.approx(1.2 * base.trunk_mass.mass_kg)


def test_link_mass_leaves_a_weight_that_is_put_on_as_it_is() -> None:
    rig = load_robot("pendulum")
    bare = changed(rig, "payload", to=None)
    loads = [
        one_joint_load(read_model(with_effect(one, "link_mass", ["arm"], scale=scale))).gravity_nm
        for scale in (1.0, 1.5)
        for one in (rig, bare)
    ]
    assert loads[0] - loads[1] == pytest.approx(loads[2] - loads[3])
    assert loads[0] > loads[1]
    assert loads[3] == pytest.approx(1.5 * loads[1])


def test_a_robot_found_lighter_than_believed_gets_shorter_steps(make: Make) -> None:
    robot = load_robot("phantomx")
    light = make(with_effect(robot, "link_mass", [], scale=0.8))
    assert make(robot).step_s == 0.001
    assert light.step_s == 0.0005
    stand(light, robot, 3.0)
    assert light.observe()["contact/trunk_n"] == 0.0


def test_an_offset_of_the_centre_of_mass_moves_where_a_pendulum_hangs() -> None:
    rig = changed(load_robot("pendulum"), "payload", to=None)
    base = one_joint_load(read_physics(rig))
    off = one_joint_load(read_model(with_effect(rig, "com_offset", ["arm"], x_m=0.005)))
    mass = rig.document["body"][0]["mass_kg"]["value"]
    down = base.gravity_nm / (mass * GRAVITY_M_S2)
    assert off.centre_rad == pytest.approx(math.atan2(0.005, down))


def test_a_longer_leg_reaches_further_and_stays_a_leg() -> None:
    robot = load_robot("marvin")
    long = read_model(with_effect(robot, "leg_geometry", ["leg4"], tibia_m=0.004, femur_m=-0.002))
    base = read_physics(robot)
    world = World(long, step_s=0.001, held=True)
    stretched = dict.fromkeys((joint.name for joint in long.joints), 0.0)
    world.place((0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 1.0), stretched)
    for leg, foot in world.feet().items():
        (mount,) = (each for each in base.legs if each.name == leg)
        reach = math.hypot(foot[0] - mount.x_m, foot[1] - mount.y_m)
        more = 0.002 if leg == "leg4" else 0.0
        assert reach == pytest.approx(sum(mount.lengths_m.values()) + more, abs=1e-6)
    world.close()
    assert long.mass_kg == base.mass_kg


def test_a_leg_mounted_askew_points_elsewhere() -> None:
    robot = load_robot("marvin")
    askew = read_model(with_effect(robot, "leg_geometry", ["leg6"], yaw_rad=0.1))
    world = World(askew, step_s=0.001, held=True)
    world.place(
        (0.0, 0.0, 0.5),
        (0.0, 0.0, 0.0, 1.0),
        dict.fromkeys((joint.name for joint in askew.joints), 0.0),
    )
    x, y, _ = world.feet()["leg6"]
    world.close()
    assert math.atan2(y, x - askew.legs[5].x_m) == pytest.approx(0.1, abs=1e-6)
