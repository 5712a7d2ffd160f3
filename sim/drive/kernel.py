"""One servo drive: controller, motor, friction, gear, supply, heat. Compiled, over flat arrays.

Every array is ``float64`` of shape (fields, servos); the fields are the integers below. Nothing
here knows a physics engine or a robot: the output shaft's angle and velocity come in, the torque of
the shaft on its load goes out. The servos of one array may as well be candidates of a parameter
search. Everything is in the servo's frame, at the output shaft, in SI.

Two masses. The rotor, with its inertia seen through the gear, is integrated here in ``substeps``
short steps; the output shaft belongs to whoever calls, and is taken to move at constant velocity
within one call. Between them is the gear: a stiff spring with damping and, if asked for, a dead
zone. Position is sensed at the output shaft, as the potentiometers of AX-12A and XL-320 do.

Motor: ``torque = k (duty V - ke w) / R``. With torque disabled the bridge is taken to be open: no
current, no torque, friction stays (assumed). A duty of 0 with torque enabled brakes.

Friction is a budget (Duclusaud et al., Extended Friction Models for the Physics Simulation of Servo
Actuators, 2025): the friction that would stop the rotor within the step, limited by a level, so
that a resting rotor rests. The level is their model M6; M1 to M5 are M6 with zeros.

All compiled code and the field numbers stay in this one file: the compiler's cache watches only the
file a function stands in.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

# --- parameters: params[field, servo]
RESISTANCE = 0  #: winding at ambient temperature [ohm]
TORQUE_CONSTANT = 1  #: output torque per current [N m/A]
BACK_EMF = 2  #: voltage per output velocity [V s/rad]
ROTOR_INERTIA = 3  #: seen at the output [kg m^2]
COULOMB = 4  #: Kc [N m]
VISCOUS = 5  #: Kv [N m s/rad]
STRIBECK = 6  #: Kcs [N m]
STRIBECK_VELOCITY = 7  #: qd_s [rad/s]
STRIBECK_EXPONENT = 8  #: alpha
LOAD_MOTOR = 9  #: Km
LOAD_EXTERNAL = 10  #: Ke
LOAD_MOTOR_STRIBECK = 11  #: Kms
LOAD_EXTERNAL_STRIBECK = 12  #: Kes
QUADRATIC_MOTOR = 13  #: Kmq [1/(N m)]
QUADRATIC_EXTERNAL = 14  #: Keq [1/(N m)]
GEAR_STIFFNESS = 15  #: [N m/rad]
GEAR_DAMPING = 16  #: [N m s/rad]
BACKLASH = 17  #: whole dead zone [rad]
SENSOR_STEP = 18  #: position resolution of the controller [rad], 0 is none
VELOCITY_SCALE = 19  #: velocity that stands for full duty in velocity mode [rad/s]
VELOCITY_GAIN = 20  #: duty per velocity error in velocity mode [s/rad]
AMBIENT = 21  #: [degC]
HEAT_RESISTANCE = 22  #: winding to ambient [K/W]
HEAT_TIME = 23  #: time constant of the winding [s]
RESISTANCE_RISE = 24  #: of the winding's resistance [1/K]
PARAMS = 25

# --- commands: commands[field, servo]; see busemu.plant.DriveCommand
ENABLED = 0  #: 0 or 1
MODE = 1  #: one of the three modes below
GOAL_POSITION = 2
GOAL_VELOCITY = 3
GOAL_DUTY = 4
VELOCITY_LIMIT = 5
DUTY_LIMIT = 6
GAIN_CW = 7
GAIN_CCW = 8
MARGIN_CW = 9
MARGIN_CCW = 10
PUNCH = 11
INTEGRAL_GAIN = 12
DERIVATIVE_GAIN = 13
COMMANDS = 14

MODE_POSITION = 0.0
MODE_VELOCITY = 1.0
MODE_PWM = 2.0

# --- states: states[field, servo]
ROTOR_POSITION = 0  #: seen at the output [rad]
ROTOR_VELOCITY = 1  #: seen at the output [rad/s]
DUTY = 2  #: held from tick to tick, -1 to 1
RAMP = 3  #: the goal as the velocity limit lets it move [rad]
INTEGRAL = 4  #: of the position error, as duty
LAST_POSITION = 5  #: as sensed at the last tick [rad]
WAS_REGULATING = 6  #: 1 when the last tick ran the position law
HEAT = 7  #: winding over ambient [K]
TORQUE = 8  #: output shaft on its load, mean over the last call [N m]
CURRENT = 9  #: motor current, mean over the last call [A]
VOLTAGE = 10  #: at the terminals during the last call [V]
STATES = 11

# --- supplies: supplies[field, group]
SUPPLY_VOLTAGE = 0  #: without load [V]
SUPPLY_RESISTANCE = 1  #: of pack and wires [ohm]
SUPPLIES = 2


class Arrays(NamedTuple):
    """All that the compiled step reads and writes. Shapes (fields, servos); supplies by group."""

    params: Array
    states: Array
    commands: Array
    supplies: Array


@njit(cache=True)
def friction_level(params: Array, i: int, velocity: float, motor: float, external: float) -> float:
    """Largest friction torque [N m] at a velocity [rad/s], motor and external torque [N m]."""
    level = params[COULOMB, i] + params[VISCOUS, i] * abs(velocity)
    level += abs(params[LOAD_MOTOR, i] * motor - params[LOAD_EXTERNAL, i] * external)
    slow = params[STRIBECK, i] + abs(
        params[LOAD_MOTOR_STRIBECK, i] * motor - params[LOAD_EXTERNAL_STRIBECK, i] * external
    )
    if motor * external < 0.0:
        if abs(motor) > abs(external):
            slow += params[QUADRATIC_EXTERNAL, i] * external * external
        else:
            slow += params[QUADRATIC_MOTOR, i] * motor * motor
    if slow != 0.0:
        ratio = abs(velocity) / params[STRIBECK_VELOCITY, i]
        level += math.exp(-(ratio ** params[STRIBECK_EXPONENT, i])) * slow
    return float(level)


@njit(cache=True)
def position_law(arrays: Arrays, i: int, position: float, tick_s: float) -> float:
    """Duty of the position law at one tick, before the duty limit; moves ramp and integral."""
    states, commands = arrays.states, arrays.commands
    if states[WAS_REGULATING, i] == 0.0:
        states[RAMP, i] = position
        states[INTEGRAL, i] = 0.0
        states[LAST_POSITION, i] = position
    reach = commands[VELOCITY_LIMIT, i] * tick_s
    ahead = commands[GOAL_POSITION, i] - states[RAMP, i]
    if ahead > reach:
        states[RAMP, i] += reach
    elif ahead < -reach:
        states[RAMP, i] -= reach
    else:
        states[RAMP, i] = commands[GOAL_POSITION, i]
    error = states[RAMP, i] - position
    if error > 0.0:
        gain, margin, sign = commands[GAIN_CCW, i], commands[MARGIN_CCW, i], 1.0
    else:
        gain, margin, sign = commands[GAIN_CW, i], commands[MARGIN_CW, i], -1.0
    beyond = abs(error) - margin
    if beyond <= 0.0:
        return 0.0
    limit = commands[DUTY_LIMIT, i]
    total = states[INTEGRAL, i] + commands[INTEGRAL_GAIN, i] * error * tick_s
    states[INTEGRAL, i] = min(limit, max(-limit, total))  # no wind-up beyond full duty
    duty = sign * (commands[PUNCH, i] + gain * beyond) + states[INTEGRAL, i]
    moved = position - states[LAST_POSITION, i]
    return float(duty - commands[DERIVATIVE_GAIN, i] * moved / tick_s)


@njit(cache=True)
def control(arrays: Arrays, position: Array, velocity: Array, tick_s: float) -> None:
    """One tick of every servo's firmware: sets the duty that holds until the next tick.

    ``position`` [rad] and ``velocity`` [rad/s] are those of the output shafts at the tick.
    """
    params, states, commands = arrays.params, arrays.states, arrays.commands
    for i in range(position.size):
        sensed = position[i]
        if params[SENSOR_STEP, i] > 0.0:
            sensed = math.floor(sensed / params[SENSOR_STEP, i] + 0.5) * params[SENSOR_STEP, i]
        enabled = commands[ENABLED, i] != 0.0
        mode = commands[MODE, i]
        duty = 0.0
        regulating = 0.0
        if enabled and mode == MODE_POSITION:
            duty = position_law(arrays, i, sensed, tick_s)
            regulating = 1.0
        elif enabled and mode == MODE_VELOCITY:
            goal = commands[GOAL_VELOCITY, i]
            duty = goal / params[VELOCITY_SCALE, i]
            duty += params[VELOCITY_GAIN, i] * (goal - velocity[i])
        elif enabled:
            duty = commands[GOAL_DUTY, i]
        limit = commands[DUTY_LIMIT, i]
        states[DUTY, i] = min(limit, max(-limit, duty))
        states[WAS_REGULATING, i] = regulating
        states[LAST_POSITION, i] = sensed


@njit(cache=True)
def gear_torque(params: Array, i: int, twist: float, twist_rate: float) -> float:
    """Torque of the rotor on the output shaft [N m] at a twist of the gear [rad, rad/s]."""
    half = 0.5 * params[BACKLASH, i]
    if half > 0.0:
        if twist > half:
            twist -= half
        elif twist < -half:
            twist += half
        else:
            return 0.0
    return float(params[GEAR_STIFFNESS, i] * twist + params[GEAR_DAMPING, i] * twist_rate)


@njit(cache=True)
def share_supply(arrays: Arrays) -> None:
    """Terminal voltage of every servo, with the sag its group's current causes.

    Servos are split evenly, in order, over the groups of ``supplies``. What a bridge draws is
    ``duty`` times its motor's current; the sag is solved for, not iterated. Never below 0, never
    above the unloaded voltage (a diode keeps current from flowing back; assumed).
    """
    params, states, commands, supplies = arrays
    groups = supplies.shape[1]
    size = states.shape[1] // groups
    for g in range(groups):
        source = supplies[SUPPLY_VOLTAGE, g]
        conductance = 0.0
        returned = 0.0
        for i in range(g * size, (g + 1) * size):
            if commands[ENABLED, i] != 0.0:
                duty = states[DUTY, i]
                resistance = params[RESISTANCE, i]
                resistance *= 1.0 + params[RESISTANCE_RISE, i] * states[HEAT, i]
                conductance += duty * duty / resistance
                returned += duty * params[BACK_EMF, i] * states[ROTOR_VELOCITY, i] / resistance
        inner = supplies[SUPPLY_RESISTANCE, g]
        voltage = (source + inner * returned) / (1.0 + inner * conductance)
        voltage = min(source, max(0.0, voltage))
        for i in range(g * size, (g + 1) * size):
            states[VOLTAGE, i] = voltage


@njit(cache=True)
def drive(arrays: Arrays, position: Array, velocity: Array, step_s: float, substeps: int) -> None:
    """Move every rotor by ``step_s``; ``states[TORQUE]`` is then the mean torque on the load.

    ``position`` [rad] and ``velocity`` [rad/s] are those of the output shafts at the beginning.
    """
    params, states, commands, _ = arrays
    share_supply(arrays)
    dt = step_s / substeps
    for i in range(position.size):
        heat = states[HEAT, i]
        resistance = params[RESISTANCE, i] * (1.0 + params[RESISTANCE_RISE, i] * heat)
        inertia = params[ROTOR_INERTIA, i]
        drive_v = states[DUTY, i] * states[VOLTAGE, i]
        enabled = commands[ENABLED, i] != 0.0
        angle = states[ROTOR_POSITION, i]
        speed = states[ROTOR_VELOCITY, i]
        torque_sum = 0.0
        current_sum = 0.0
        square_sum = 0.0
        for j in range(substeps):
            shaft = position[i] + velocity[i] * j * dt
            load = gear_torque(params, i, angle - shaft, speed - velocity[i])
            current = 0.0
            if enabled:
                current = (drive_v - params[BACK_EMF, i] * speed) / resistance
            motor = params[TORQUE_CONSTANT, i] * current
            level = friction_level(params, i, speed, motor, -load)
            stop = -(inertia * speed / dt + motor - load)
            friction = min(level, max(-level, stop))
            speed += dt / inertia * (motor - load + friction)
            angle += dt * speed
            torque_sum += load
            current_sum += current
            square_sum += current * current
        states[ROTOR_POSITION, i] = angle
        states[ROTOR_VELOCITY, i] = speed
        states[TORQUE, i] = torque_sum / substeps
        states[CURRENT, i] = current_sum / substeps
        power = resistance * square_sum / substeps
        gain = params[HEAT_RESISTANCE, i] * power - heat
        states[HEAT, i] = heat + step_s / params[HEAT_TIME, i] * gain
