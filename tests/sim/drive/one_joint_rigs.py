"""One servo and a load of one joint, as plain as the tests of the rollouts want them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from busemu.plant import DriveCommand, OperatingMode
from busemu.tables import load_robot
from sim.drive import fields, lanes
from sim.drive.bank import command_column
from sim.drive.parameters import DriveParameters, Friction
from sim.robot import read_physics
from sim.rollout import Batch, Candidate, Load, Replay
from sim.stepped import TICK_S
from sim.tree import PhysicalRobot

VOLTAGE_V = 12.0
GRAVITY_NM = 0.3
INERTIA_KG_M2 = 3e-3
OFF = DriveCommand()
GAIN_PER_RAD = 5.0


def plain_drive(**changes: Any) -> DriveParameters:
    """The motor of an AX-12A: no friction, no counts, cold, a rigid gear."""
    drive = rig().joints[0].drive
    plain = {
        "friction": Friction(),
        "sensor_step_rad": 0.0,
        "resistance_rise_per_k": 0.0,
        "gear_stiffness_nm_rad": math.inf,
        "gear_damping_nm_s_rad": 0.0,
    }
    return replace(drive, **(plain | changes))


def rig() -> PhysicalRobot:
    """The pendulum's own physics."""
    return read_physics(load_robot("pendulum"))


def pendulum(
    gravity_nm: float = GRAVITY_NM, centre_rad: float = 0.0, inertia_kg_m2: float = INERTIA_KG_M2
) -> Load:
    """A load that hangs at an angle."""
    return Load.pendulum(inertia_kg_m2, gravity_nm, centre_rad, max(gravity_nm, 1e-9))


def level(inertia_kg_m2: float = INERTIA_KG_M2) -> Load:
    """A load that gravity does not turn."""
    return pendulum(0.0, inertia_kg_m2=inertia_kg_m2)


def candidate(
    drive: DriveParameters | None = None,
    load: Load | None = None,
    source_ohm: float = 0.0,
    **more: float,
) -> Candidate:
    """A servo with a load on a supply of :data:`VOLTAGE_V`."""
    column = (plain_drive() if drive is None else drive).column()
    load = pendulum() if load is None else load
    return Candidate(column, load, more.pop("voltage_v", VOLTAGE_V), source_ohm, **more)


def regulating(goal_rad: float = 0.0, gain_per_rad: float = GAIN_PER_RAD, **more: Any) -> Any:
    """A position law."""
    return DriveCommand(
        torque_enable=True,
        goal_position_rad=goal_rad,
        gain_cw_per_rad=gain_per_rad,
        gain_ccw_per_rad=gain_per_rad,
        **more,
    )


def pushing(duty: float) -> DriveCommand:
    """A duty, and nothing that regulates it."""
    return DriveCommand(torque_enable=True, operating_mode=OperatingMode.PWM, goal_duty=duty)


def replay(
    command: DriveCommand = OFF,
    events: Iterable[tuple[float, int, float]] = (),
    samples: Any = None,
    position_rad: float = 0.0,
    velocity_rad_s: float = 0.0,
    duration_s: float = 1.0,
) -> Replay:
    """What happened at a port; sampled at every tick, if nothing else is said."""
    if samples is None:
        samples = np.arange(round(duration_s / TICK_S) + 1) * TICK_S
    return Replay(
        command_column(command),
        np.array(list(events), np.float64).reshape(-1, 3),
        np.asarray(samples, np.float64),
        position_rad,
        velocity_rad_s,
    )


def goals(t_s: Any, goal_rad: Any) -> list[tuple[float, int, float]]:
    """Writes of goals."""
    return [
        (t, fields.GOAL_POSITION, g)
        for t, g in zip(np.asarray(t_s).tolist(), np.asarray(goal_rad).tolist(), strict=True)
    ]


def swinging(duration_s: float = 2.0, every_s: float = 0.01, **more: Any) -> Replay:
    """A goal that swings, with pauses, as a bus brings it."""
    t = np.arange(0.0, duration_s, every_s)
    goal = 0.8 * np.sin(5.0 * t) * np.sin(1.3 * t)
    return replay(regulating(), events=goals(t, goal), duration_s=duration_s, **more)


def run(one: Candidate, to: Replay, threads: int = 1) -> np.ndarray:
    """One candidate on one replay: (samples, channels)."""
    return Batch([to], threads).run([one], [0])[0]


def regulated(one: Candidate, to: Replay, sensed_rad: Sequence[float] | np.ndarray) -> np.ndarray:
    """Duty of a controller along angles."""
    return Batch([to], 1).regulate([one], [0], [np.asarray(sensed_rad, np.float64)])[0]


def position(out: np.ndarray) -> np.ndarray:
    return out[:, lanes.OUT_POSITION]


def periods_s(angle: np.ndarray) -> np.ndarray:
    """Periods of an oscillation about 0 that was sampled at every tick, from its zeros."""
    before = np.flatnonzero(np.diff(np.sign(angle)))
    zeros = before + angle[before] / (angle[before] - angle[before + 1])
    return 2.0 * np.diff(zeros) * TICK_S
