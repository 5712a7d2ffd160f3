"""Effects of drive, controller, supply, sensing: off they are nothing, on they move their own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from one_joint_rigs import goals, regulating, replay, rig

from sim.drive import lanes
from sim.effects import Group, catalogue, effect
from sim.one_joint import one_joint_load
from sim.rollout import Batch, Candidate, Load, Replay
from sim.tree import PhysicalRobot, Supply

GROUPS = (Group.GEAR, Group.FRICTION, Group.CONTROLLER, Group.ELECTRICAL, Group.SENSING)

P, D, V, R = "position", "duty", "voltage", "regulated duty"
COLUMNS = {P: lanes.OUT_POSITION, D: lanes.OUT_DUTY, V: lanes.OUT_VOLTAGE}

#: what an effect of typical size moves in a rig on a stiff supply; it must move nothing else
MOVES: Mapping[str, set[str]] = {
    # gear, friction, motor: the controller follows only by what it sees
    "backlash": {P, D},
    "joint_compliance": {P, D},
    "gear_spring": set(),  # a rigid gear stays rigid
    "rotor_inertia": {P, D},
    "viscous_friction": {P, D},
    "coulomb_friction": {P, D},
    "stribeck_friction": {P, D},
    "load_friction": {P, D},
    "directional_load_friction": {P, D},
    "cable_drag": {P, D},
    "torque_constant": {P, D},
    "back_emf": {P, D},
    "stall_torque": {P, D},
    "current_limit": {P, D},
    "torque_droop": {P, D},
    "thermal_derating": {P, D},
    # controller: the duty itself, along the very same angles
    "dead_zone": {P, D, R},
    "punch": {P, D, R},
    "presliding": {P, D},
    "punch_left_out": set(),  # what is not there cannot be left out
    "load_of_gear": set(),  # of no load friction
    "gain_error": {P, D, R},
    "integral_action": {P, D, R},
    "velocity_limit": {P, D, R},
    "acceleration_limit": {P, D, R},
    "torque_limit": {P, D, R},
    "transport_delay": {P, D, R},
    "overload_shutdown": {P, D, R},
    # supply
    "supply_voltage": {P, D, V},
    "voltage_sag": {P, D, V},
    # sensing
    "zero_offset": {P, D},
    "encoder_nonlinearity": {P, D},
    "read_skew": {P, R},  # along angles that are of other instants than they are shown at
    "load_refresh": {D},
    "latency_timer": set(),  # of the bus: replies, not instants
    "lost_samples": set(),
}


def base() -> PhysicalRobot:
    """The pendulum on a stiff supply, with a rigid gear."""
    robot = rig()
    (joint,) = robot.joints
    drive = replace(joint.drive, gear_stiffness_nm_rad=math.inf, gear_damping_nm_s_rad=0.0)
    return replace(
        robot,
        supply=Supply(robot.supply.voltage_v, 0.0),
        joints=(replace(joint, drive=drive),),
    )


def told() -> Replay:
    """A swing, then a push against something too heavy: all that any effect acts on."""
    t = np.arange(0.0, 4.0, 0.02)
    goal = np.where(t < 1.5, 0.9 * np.sin(7.0 * t), 2.2)
    return replay(regulating(), goals(t, goal), np.arange(0.0, 4.0, 0.007), position_rad=0.1)


def outputs(robot: PhysicalRobot) -> dict[str, np.ndarray]:
    load = one_joint_load(robot)
    heavy = 8.0 * load.gravity_nm  # the servo cannot lift it to the last goal
    pull = Load.pendulum(load.inertia_kg_m2, heavy, load.centre_rad, heavy)
    one = Candidate.of(robot, 0, pull, rigid=False)
    batch = Batch([told()], 1)
    out = batch.run([one], [0])[0]
    found = {name: out[:, column] for name, column in COLUMNS.items()}
    angles = 0.7 * np.sin(7.0 * told().samples - 0.4)
    return found | {R: batch.regulate([one], [0], [angles])[0]}


@pytest.fixture(scope="module")
def plain() -> dict[str, np.ndarray]:
    return outputs(base())


def test_every_effect_of_drive_supply_and_sensing_is_judged_here() -> None:
    assert set(MOVES) == {e.name for e in catalogue().values() if e.group in GROUPS}


@pytest.mark.parametrize("name", sorted(MOVES))
def test_off_is_the_base_model_to_the_bit(name: str, plain: dict[str, np.ndarray]) -> None:
    off = effect(name).apply(base(), (), effect(name).off)
    assert off == base()
    for word, values in outputs(off).items():
        assert (values == plain[word]).all(), word


@pytest.mark.parametrize("name", sorted(MOVES))
def test_an_effect_moves_its_own_outputs_and_no_other(
    name: str, plain: dict[str, np.ndarray]
) -> None:
    on = outputs(effect(name).apply(base(), (), effect(name).typical))
    assert {word for word in plain if (on[word] != plain[word]).any()} == MOVES[name]


@pytest.mark.parametrize("name", sorted(MOVES))
def test_a_shape_alone_does_nothing(name: str, plain: dict[str, np.ndarray]) -> None:
    """A parameter that only shapes an effect, typical or at an end, with the effect off."""
    for parameter in effect(name).parameters:
        if parameter.shape:
            for value in (parameter.low, parameter.typical, parameter.high):
                shaped = effect(name).apply(base(), (), effect(name).off | {parameter.name: value})
                for word, values in outputs(shaped).items():
                    assert (values == plain[word]).all(), (parameter.name, value, word)


@pytest.mark.parametrize("name", sorted(MOVES))
def test_the_bounds_of_an_effect_can_be_rolled_out(name: str) -> None:
    """No value the catalogue allows makes a rollout blow up."""
    for parameter in effect(name).parameters:
        for value in (parameter.low, parameter.high):
            robot = effect(name).apply(base(), (), {parameter.name: value})
            for word, values in outputs(robot).items():
                assert np.isfinite(values).all(), (parameter.name, value, word)
            assert np.abs(outputs(robot)[P]).max() < 2.0 * math.pi, (parameter.name, value)
