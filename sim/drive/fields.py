"""What stands where in the drives' arrays: parameters, commands, states and supplies.

Every array is ``float64`` of shape (fields, servos), that of supplies (fields, groups); the fields
are the integers below. The servos of one array may as well be candidates of a parameter search.
Everything is in the servo's frame, at the output shaft, in SI.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
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
GAIN_SCALE = 25  #: of the position law's gains, as the servo has them over what the registers say
MARGIN_MORE = 26  #: added to both compliance margins [rad]
PUNCH_MORE = 27  #: added to the punch [duty]
INTEGRAL_MORE = 28  #: added to the integral gain [1/(rad s)]
VELOCITY_CAP = 29  #: velocity limit nobody set [rad/s], infinite is none
DUTY_CAP = 30  #: duty limit nobody set
CURRENT_CAP = 31  #: of the bridge [A], infinite is none
DELAY = 32  #: from a goal's arrival to the controller [s]
ZERO_OFFSET = 33  #: of the sensed position [rad]
WAVE = 34  #: amplitude of the sensor's nonlinearity [rad]
WAVE_PERIODS = 35  #: of it in a turn
WAVE_PHASE = 36  #: of it [rad]
CABLE_STIFFNESS = 37  #: of a cable on the output shaft [N m/rad]
CABLE_REST = 38  #: angle at which it is slack [rad]
WINDING_HEAT_RESISTANCE = 39  #: winding to case [K/W], 0 when both are one
WINDING_HEAT_TIME = 40  #: its time constant [s]
OVERLOAD_DUTY = 41  #: duty that counts as overload, above 1 is never
OVERLOAD_TIME = 42  #: how long until the drive shuts down [s]
TORQUE_DROOP = 43  #: how far torque falls behind the current as that grows [1/A]
PUNCH_LEFT_OUT = 44  #: share of the command's punch that is left out of the duty
BREAKAWAY = 45  #: angle by which friction gives way before it slips [rad]
ACCELERATION_CAP = 46  #: acceleration limit nobody set [rad/s^2], infinite is none
LOAD_OF_GEAR = 47  #: share of what the gear passes on in friction's external torque
PARAMS = 48
FALLING = (  #: those of friction that falls with velocity
    STRIBECK,
    LOAD_MOTOR_STRIBECK,
    LOAD_EXTERNAL_STRIBECK,
    QUADRATIC_MOTOR,
    QUADRATIC_EXTERNAL,
)

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
ACCELERATION_LIMIT = 14
COMMANDS = 15
#: what comes late by a drive's delay; whatever else is told holds at once
GOALS = (GOAL_POSITION, GOAL_VELOCITY, GOAL_DUTY)

MODE_POSITION = 0.0
MODE_VELOCITY = 1.0
MODE_PWM = 2.0

# --- states: states[field, servo]
ROTOR_POSITION = 0  #: seen at the output [rad]
ROTOR_VELOCITY = 1  #: seen at the output [rad/s]
DUTY = 2  #: held from tick to tick, -1 to 1
RAMP = 3  #: the goal as the limits of velocity and acceleration let it move [rad]
INTEGRAL = 4  #: of the position error, as duty
LAST_POSITION = 5  #: as sensed at the last tick [rad]
WAS_REGULATING = 6  #: 1 when the last tick ran the position law, 2 the velocity law
HEAT = 7  #: winding over ambient [K]
TORQUE = 8  #: output shaft on its load, mean over the last call [N m]
CURRENT = 9  #: motor current, mean over the last call [A]
VOLTAGE = 10  #: at the terminals during the last call [V]
WINDING_HEAT = 11  #: winding over case [K]
OVERLOADED = 12  #: for how long [s]; negative once it has shut down
BENT = 13  #: how far friction has given way, towards positive velocities [rad]
PACE = 14  #: how fast the goal moves where its acceleration has a limit, else infinite [rad/s]
STATES = 15

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
