"""PyBullet against MuJoCo on the same rigs: an error of either engine would show between them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from sim_rigs import changed, with_effect

from busemu.tables import Robot, load_robot
from sim.model import read_model
from sim.world import BulletPlant, World

engines = pytest.importorskip("engines", reason="needs MuJoCo: pip install 'busemu[proof]'")

RIGS = ("pendulum", "marvin-leg", "arm")
SECONDS = 1.6
ROUNDING_RAD = 1e-9  #: rounding errors, grown over 1600 steps


def rms_rad(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(np.mean((one - other) ** 2)))


@pytest.mark.parametrize("name", RIGS)
def test_both_engines_have_the_same_inverse_mass_matrix(name: str) -> None:
    robot = load_robot(name)
    model = read_model(robot, condition={"payload_kg": 0.1} if name != "marvin-leg" else None)
    bullet = World(model, step_s=0.001)
    other = engines.MujocoWorld(model, step_s=0.001)
    rng = np.random.default_rng(5)
    order = [joint.name for joint in model.joints]
    for _ in range(20):
        pose = {j.name: float(rng.uniform(j.lower_rad, j.upper_rad)) for j in model.joints}
        bullet.place((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), pose)
        other.place(pose, order)
        one, two = bullet.inverse_mass(), other.inverse_mass()
        assert one == pytest.approx(two, rel=1e-6, abs=1e-6 * float(np.abs(two).max()))
    bullet.close()


@pytest.mark.parametrize("name", RIGS)
def test_driven_rigs_move_alike_to_rounding(name: str) -> None:
    robot = load_robot(name)
    bullet = engines.run(BulletPlant(robot), robot, SECONDS)
    other = engines.run(engines.mujoco_plant(robot), robot, SECONDS)
    assert np.ptp(bullet, axis=0).min() > 0.3
    assert rms_rad(bullet, other) < ROUNDING_RAD


EFFECTS: dict[str, tuple[Robot, dict[str, Any]]] = {
    "payload": (load_robot("arm"), {"name": "payload", "mass_kg": 0.08, "x_m": 0.01}),
    "link_mass": (load_robot("arm"), {"name": "link_mass", "scale": 1.3}),
    "com_offset": (load_robot("arm"), {"name": "com_offset", "x_m": 0.01, "z_m": -0.01}),
    "ground_tilt": (load_robot("arm"), {"name": "ground_tilt", "pitch_rad": 0.1, "roll_rad": 0.2}),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_effects_of_bodies_move_a_rig_alike_in_both_engines(name: str) -> None:
    base, values = EFFECTS[name]
    robot = with_effect(
        base, values["name"], [], **{k: v for k, v in values.items() if k != "name"}
    )
    bullet = engines.run(BulletPlant(robot), robot, SECONDS)
    other = engines.run(engines.mujoco_plant(robot), robot, SECONDS)
    without = engines.run(BulletPlant(base), base, SECONDS)
    assert rms_rad(bullet, other) < ROUNDING_RAD
    assert rms_rad(bullet, without) > 1e-3


def test_a_weight_of_a_condition_moves_a_rig_alike_in_both_engines() -> None:
    robot = load_robot("pendulum")
    words = {"payload_kg": 0.4, "payload_at_m": 0.1, "payload_inertia_kg_m2": 1e-4}
    bullet = engines.run(BulletPlant(robot, condition=words), robot, SECONDS)
    other = engines.run(engines.mujoco_plant(robot, condition=words), robot, SECONDS)
    assert rms_rad(bullet, other) < ROUNDING_RAD


def test_steps_of_1_ms_are_near_a_finer_integrator_of_the_other_engine() -> None:
    """Within a count of the sensor of Runge and Kutta's at an eighth of the step."""
    leg = load_robot("marvin-leg")
    smooth = changed(
        leg, "drive", "XL-320", "sensor_step_rad", to={"value": 0.0, "source": "assumed"}
    )
    bullet = engines.run(BulletPlant(smooth), smooth, SECONDS)
    fine = engines.run(engines.mujoco_plant(smooth, steps_per_tick=8, fine=True), smooth, SECONDS)
    assert float(np.abs(bullet - fine).max()) < math.radians(300.0 / 1024.0)
