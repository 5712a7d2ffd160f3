"""One servo drive: controller, motor, friction, gear, supply, heat. Compiled, over flat arrays.

Every array is ``float64`` of shape (fields, servos); the fields are the integers below. Nothing
here knows a physics engine or a robot: the output shaft's angle and velocity come in, the torque of
the shaft on its load goes out. The servos of one array may as well be candidates of a parameter
search. Everything is in the servo's frame, at the output shaft, in SI.

Two masses. The rotor, with its inertia seen through the gear, is integrated here in ``substeps``
short steps. Between it and the output shaft is the gear: a stiff spring with damping and, if asked
for, a dead zone. Position is sensed at the output shaft, as the potentiometers of AX-12A and XL-320
do. The shaft and its load belong

* to a physics engine (:func:`drive`): the shaft is taken to move at constant velocity within one
  call. A rigid gear (infinite stiffness) is impossible there;
* or to :func:`rollout`, which moves a load of one joint itself, in the same substeps. There the
  gear may be rigid: rotor and load are then one mass, which allows much longer steps. Its jobs go
  in groups, in lockstep: the compiler makes one vector of the same number of several jobs.

Motor: ``torque = k i / (1 + droop |i|)`` with ``i = (duty V - ke w) / R``; the droop of most is
0. With torque disabled the bridge is taken to be open: no current, no torque, friction stays
(assumed). A duty of 0 with torque enabled brakes.

Friction is a budget (Duclusaud et al., Extended Friction Models for the Physics Simulation of Servo
Actuators, 2025): the friction that would stop the rotor within the step, limited by a level, so
that a resting rotor rests. The level is their model M6; M1 to M5 are M6 with zeros.

All compiled code and the field numbers stay in this one file: the compiler's cache watches only the
file a function stands in.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Function = TypeVar("Function", bound=Callable[..., Any])

OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}


def compiled(function: Function) -> Function:
    """Compile without reference counts: nothing here allocates, and calls cost a third then."""
    return cast(Function, njit(**OPTIONS)(function))


def inlined(function: Function) -> Function:
    """The same, into whatever calls it: a loop over lanes becomes one over vectors then."""
    return cast(Function, njit(forceinline=True, **OPTIONS)(function))


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
DELAY = 32  #: from a command's arrival to the controller [s]
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
PARAMS = 44
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
WINDING_HEAT = 11  #: winding over case [K]
OVERLOADED = 12  #: for how long [s]; negative once it has shut down
STATES = 13

# --- loads of rollouts: loads[field, job]
LOAD_INERTIA = 0  #: about the joint's axis [kg m^2]
SHAFT_POSITION = 1  #: of the output shaft, at the start and then as it moves [rad]
SHAFT_VELOCITY = 2  #: [rad/s]
SHAFT_FRICTION = 3  #: Coulomb friction of the load's own bearing [N m]
SAMPLE_SKEW = 4  #: angle and speed are of an instant this much later than their samples' [s]
DUTY_REFRESH = 5  #: what a sample shows of the duty is made anew in this period [s], 0 is always
DUTY_PHASE = 6  #: when that first happens [s]
LOADS = 7

# --- what a rollout gives of a sample: out[job, sample, channel]
OUT_POSITION = 0  #: as the servo senses it, without quantisation [rad]
OUT_VELOCITY = 1  #: [rad/s]
OUT_DUTY = 2
OUT_VOLTAGE = 3  #: at the terminals [V]
OUT_CURRENT = 4  #: of the motor [A]
OUT_HEAT = 5  #: winding over ambient [K]
CHANNELS = 6

# --- supplies: supplies[field, group]
SUPPLY_VOLTAGE = 0  #: without load [V]
SUPPLY_RESISTANCE = 1  #: of pack and wires [ohm]
SUPPLIES = 2

# --- what a rollout remembers of its lanes: lanes[field, lane]
NEXT_EVENT = 0  #: when there is something new to hear [s]
NEXT_SEEN = 1  #: of what instant the next sample's angle is [s]
NEXT_SAMPLE = 2  #: when the rest of the next sample is taken [s]
DUTY_DUE = 3  #: when what a sample shows of the duty is made anew [s]
DUTY_SHOWN = 4
COSINE = 5  #: gravity's torque at an angle of 0, see Jobs [N m]
SINE = 6  #: gravity's torque at a quarter turn, negative [N m]
TICK_POSITION = 7  #: of the shaft at the beginning of the tick [rad]
TICK_SENSED = 8  #: of the shaft, as sensed [rad]
TICK_VELOCITY = 9  #: of the shaft [rad/s]
PULL = 10  #: of gravity and cable at the beginning of the tick [N m]
SLOPE = 11  #: of that over the shaft's angle [N m/rad]
VOLTS = 12  #: see Train
CONDUCTANCE = 13  #: see Train
HALT = 14  #: torque that stops a speed of the rotor within a substep [N m s/rad]
PUSH = 15  #: speed that a torque on the rotor makes within a substep [rad/(s N m)]
LOAD_HALT = 16  #: the same of the load
LOAD_PUSH = 17
CURRENT_SUM = 18  #: over the tick's substeps [A]
SQUARE_SUM = 19  #: over the tick's substeps [A^2]
TICK_COSINE = 20  #: of the shaft's angle at the beginning of the tick
TICK_SINE = 21  #: of the shaft's angle
MEMORIES = 22

# --- how far a rollout's lanes are: at[field, lane]
EVENT = 0  #: number of the next event
SEEN = 1  #: number of the next sample whose angle is to be seen
SAMPLE = 2  #: number of the next sample whose rest is to be taken
TICKS = 3  #: how many ticks there are
GRAVITIES = 4  #: how many rows of gravity there are, 1 where it does not turn
PLACES = 5

# --- a group of jobs, rolled out in lockstep: group[row, lane]. All is in one array: the compiler
# then knows how far rows lie apart, and that a vector of lanes can be read, moved and written
LANES = 16  #: in a group; two vectors of eight hide each other's latency
FEW = 4  #: jobs that are done one after the other rather than as a whole group
OF_STATES = PARAMS
OF_COMMANDS = OF_STATES + STATES
OF_SUPPLIES = OF_COMMANDS + COMMANDS
OF_LOADS = OF_SUPPLIES + SUPPLIES
OF_LANES = OF_LOADS + LOADS
ROWS = OF_LANES + MEMORIES

SUPPLY_EVENT = 100  #: an event's field from here on is one of the supplies'


class Arrays(NamedTuple):
    """All that the compiled step reads and writes. Shapes (fields, servos); supplies by group."""

    params: Array
    states: Array
    commands: Array
    supplies: Array


class Train(NamedTuple):
    """What the rotor's motion within one tick takes from the arrays, as plain numbers."""

    volts: float  #: at the bridge, 0 when it is open
    conductance: float  #: of the winding, 0 when the bridge is open
    torque_constant: float
    back_emf: float
    current_cap: float
    torque_droop: float
    coulomb: float
    viscous: float
    load_motor: float
    load_external: float
    stribeck: float
    stribeck_velocity: float
    stribeck_exponent: float
    load_motor_stribeck: float
    load_external_stribeck: float
    quadratic_motor: float
    quadratic_external: float
    slow: bool  #: whether any term falls with velocity
    stiffness: float
    damping: float
    half_backlash: float


@inlined
def falling(params: Array, i: int) -> bool:
    """Whether any term of a servo's friction falls with velocity."""
    found = False
    for field in FALLING:
        found |= params[field, i] != 0.0
    return found


@inlined
def bridge(arrays: Arrays, i: int) -> tuple[float, float]:
    """Voltage at a winding [V] and its conductance [S], both 0 while the bridge is open."""
    closed = 1.0 if running(arrays, i) else 0.0
    volts = closed * arrays.states[DUTY, i] * arrays.states[VOLTAGE, i]
    return volts, closed / winding_resistance(arrays, i)


@inlined
def train(params: Array, i: int, volts: float, conductance: float, slow: bool) -> Train:
    """One servo's drive train; see :func:`bridge` and :func:`falling`."""
    return Train(
        volts,
        conductance,
        params[TORQUE_CONSTANT, i],
        params[BACK_EMF, i],
        params[CURRENT_CAP, i],
        params[TORQUE_DROOP, i],
        params[COULOMB, i],
        params[VISCOUS, i],
        params[LOAD_MOTOR, i],
        params[LOAD_EXTERNAL, i],
        params[STRIBECK, i],
        params[STRIBECK_VELOCITY, i],
        params[STRIBECK_EXPONENT, i],
        params[LOAD_MOTOR_STRIBECK, i],
        params[LOAD_EXTERNAL_STRIBECK, i],
        params[QUADRATIC_MOTOR, i],
        params[QUADRATIC_EXTERNAL, i],
        slow,
        params[GEAR_STIFFNESS, i],
        params[GEAR_DAMPING, i],
        0.5 * params[BACKLASH, i],
    )


@inlined
def friction_level(t: Train, velocity: float, motor: float, external: float) -> float:
    """Largest friction torque [N m] at a velocity [rad/s], motor and external torque [N m]."""
    level = t.coulomb + t.viscous * abs(velocity)
    level += abs(t.load_motor * motor - t.load_external * external)
    if t.slow:
        slow = t.stribeck
        slow += abs(t.load_motor_stribeck * motor - t.load_external_stribeck * external)
        if motor * external < 0.0:
            if abs(motor) > abs(external):
                slow += t.quadratic_external * external * external
            else:
                slow += t.quadratic_motor * motor * motor
        ratio = abs(velocity) / t.stribeck_velocity
        if t.stribeck_exponent != 1.0:  # most are, and a power takes longer than all the rest
            ratio **= t.stribeck_exponent
        level += math.exp(-ratio) * slow
    return float(level)


@inlined
def motor_current(t: Train, speed: float) -> float:
    """Current of a motor at a rotor's velocity [A]."""
    current = t.conductance * (t.volts - t.back_emf * speed)
    return float(min(t.current_cap, max(-t.current_cap, current)))


@inlined
def motor_torque(t: Train, current: float) -> float:
    """Torque of a motor at a current, before friction [N m]."""
    torque = t.torque_constant * current
    if t.torque_droop == 0.0:
        return float(torque)
    return float(torque / (1.0 + t.torque_droop * abs(current)))


@inlined
def gear_torque(t: Train, twist: float, twist_rate: float) -> float:
    """Torque of the rotor on the output shaft [N m] at a twist of the gear [rad, rad/s]."""
    if t.half_backlash > 0.0:
        if twist > t.half_backlash:
            twist -= t.half_backlash
        elif twist < -t.half_backlash:
            twist += t.half_backlash
        else:
            return 0.0
    return float(t.stiffness * twist + t.damping * twist_rate)


@inlined
def position_law(arrays: Arrays, i: int, position: float, tick_s: float) -> float:
    """Duty of the position law at one tick, before the duty limit; moves ramp and integral."""
    states, commands = arrays.states, arrays.commands
    # both are read: a row that depends on the error could not be read for many lanes at once
    cw_gain, cw_margin = commands[GAIN_CW, i], commands[MARGIN_CW, i]
    ccw_gain, ccw_margin = commands[GAIN_CCW, i], commands[MARGIN_CCW, i]
    if states[WAS_REGULATING, i] == 0.0:
        states[RAMP, i] = position
        states[INTEGRAL, i] = 0.0
        states[LAST_POSITION, i] = position
    params = arrays.params
    reach = min(commands[VELOCITY_LIMIT, i], params[VELOCITY_CAP, i]) * tick_s
    ahead = commands[GOAL_POSITION, i] - states[RAMP, i]
    if ahead > reach:
        states[RAMP, i] += reach
    elif ahead < -reach:
        states[RAMP, i] -= reach
    else:
        states[RAMP, i] = commands[GOAL_POSITION, i]
    error = states[RAMP, i] - position
    if error > 0.0:
        gain, margin, sign = ccw_gain, ccw_margin, 1.0
    else:
        gain, margin, sign = cw_gain, cw_margin, -1.0
    gain *= params[GAIN_SCALE, i]
    beyond = abs(error) - (margin + params[MARGIN_MORE, i])
    if beyond <= 0.0:
        return 0.0
    limit = min(commands[DUTY_LIMIT, i], params[DUTY_CAP, i])
    integral_gain = commands[INTEGRAL_GAIN, i] + params[INTEGRAL_MORE, i]
    total = states[INTEGRAL, i] + integral_gain * error * tick_s
    states[INTEGRAL, i] = min(limit, max(-limit, total))  # no wind-up beyond full duty
    duty = sign * (commands[PUNCH, i] + params[PUNCH_MORE, i] + gain * beyond) + states[INTEGRAL, i]
    moved = position - states[LAST_POSITION, i]
    damping = commands[DERIVATIVE_GAIN, i] * params[GAIN_SCALE, i]
    return float(duty - damping * moved / tick_s)


@inlined
def sense(params: Array, i: int, position: float) -> float:
    """What the position sensor makes of the output shaft's angle, both [rad]."""
    if params[WAVE, i] != 0.0:
        angle = params[WAVE_PERIODS, i] * position + params[WAVE_PHASE, i]
        position += params[WAVE, i] * math.sin(angle)
    return float(position + params[ZERO_OFFSET, i])


@inlined
def control_one(arrays: Arrays, i: int, sensed: float, velocity: float, tick_s: float) -> None:
    """One tick of one servo's firmware: sets the duty that holds until the next tick.

    ``sensed`` is what :func:`sense` makes of the shaft's angle.
    """
    params, states, commands = arrays.params, arrays.states, arrays.commands
    if params[SENSOR_STEP, i] > 0.0:
        sensed = math.floor(sensed / params[SENSOR_STEP, i] + 0.5) * params[SENSOR_STEP, i]
    mode = commands[MODE, i]
    duty = 0.0
    regulating = 0.0
    if not running(arrays, i):
        pass
    elif mode == MODE_POSITION:
        duty = position_law(arrays, i, sensed, tick_s)
        regulating = 1.0
    elif mode == MODE_VELOCITY:
        goal = commands[GOAL_VELOCITY, i]
        duty = goal / params[VELOCITY_SCALE, i]
        duty += params[VELOCITY_GAIN, i] * (goal - velocity)
    else:
        duty = commands[GOAL_DUTY, i]
    limit = min(commands[DUTY_LIMIT, i], params[DUTY_CAP, i])
    duty = min(limit, max(-limit, duty))
    states[DUTY, i] = duty
    states[WAS_REGULATING, i] = regulating
    states[LAST_POSITION, i] = sensed
    if states[OVERLOADED, i] >= 0.0:
        if abs(duty) < params[OVERLOAD_DUTY, i]:
            states[OVERLOADED, i] = 0.0
        else:
            states[OVERLOADED, i] += tick_s
            if states[OVERLOADED, i] > params[OVERLOAD_TIME, i]:
                states[OVERLOADED, i] = -1.0


@inlined
def running(arrays: Arrays, i: int) -> bool:
    """Whether torque is enabled and the drive has not shut down."""
    return bool(arrays.commands[ENABLED, i] != 0.0 and arrays.states[OVERLOADED, i] >= 0.0)


@compiled
def control(arrays: Arrays, position: Array, velocity: Array, tick_s: float) -> None:
    """One tick of every servo's firmware.

    ``position`` [rad] and ``velocity`` [rad/s] are those of the output shafts at the tick.
    """
    for i in range(position.size):
        control_one(arrays, i, sense(arrays.params, i, position[i]), velocity[i], tick_s)


@inlined
def winding_resistance(arrays: Arrays, i: int) -> float:
    """Resistance of a winding at its temperature [ohm]."""
    params, states = arrays.params, arrays.states
    heat = states[HEAT, i] + states[WINDING_HEAT, i]
    return float(params[RESISTANCE, i] * (1.0 + params[RESISTANCE_RISE, i] * heat))


@inlined
def share_supply(arrays: Arrays, group: int, first: int, last: int) -> None:
    """Terminal voltage of the servos ``first`` to ``last - 1``, with the sag their current causes.

    What a bridge draws is ``duty`` times its motor's current; the sag is solved for, not iterated.
    Never below 0, never above the unloaded voltage (a diode keeps current from flowing back;
    assumed).
    """
    params, states, _, supplies = arrays
    source = supplies[SUPPLY_VOLTAGE, group]
    conductance = 0.0
    returned = 0.0
    for i in range(first, last):
        if running(arrays, i):
            duty = states[DUTY, i]
            resistance = winding_resistance(arrays, i)
            conductance += duty * duty / resistance
            returned += duty * params[BACK_EMF, i] * states[ROTOR_VELOCITY, i] / resistance
    inner = supplies[SUPPLY_RESISTANCE, group]
    voltage = (source + inner * returned) / (1.0 + inner * conductance)
    voltage = min(source, max(0.0, voltage))
    for i in range(first, last):
        states[VOLTAGE, i] = voltage


@inlined
def warm(arrays: Arrays, i: int, power: float, step_s: float) -> None:
    """Heat of winding and case after ``step_s`` at a mean loss [W]."""
    params, states = arrays.params, arrays.states
    gain = params[HEAT_RESISTANCE, i] * power - states[HEAT, i]
    states[HEAT, i] += step_s / params[HEAT_TIME, i] * gain
    gain = params[WINDING_HEAT_RESISTANCE, i] * power - states[WINDING_HEAT, i]
    states[WINDING_HEAT, i] += step_s / params[WINDING_HEAT_TIME, i] * gain


@inlined
def cable_torque(params: Array, i: int, position: float) -> float:
    """Torque of a cable on the output shaft [N m]."""
    return float(params[CABLE_STIFFNESS, i] * (params[CABLE_REST, i] - position))


@compiled
def drive(arrays: Arrays, position: Array, velocity: Array, step_s: float, substeps: int) -> None:
    """Move every rotor by ``step_s``; ``states[TORQUE]`` is then the mean torque on the load.

    ``position`` [rad] and ``velocity`` [rad/s] are those of the output shafts at the beginning. The
    servos are split evenly, in order, over the groups of ``supplies``.
    """
    params, states, _, supplies = arrays
    groups = supplies.shape[1]
    size = position.size // groups
    for g in range(groups):
        share_supply(arrays, g, g * size, (g + 1) * size)
    dt = step_s / substeps
    for i in range(position.size):
        volts, conductance = bridge(arrays, i)
        t = train(params, i, volts, conductance, falling(params, i))
        inertia = params[ROTOR_INERTIA, i]
        halt, push = inertia / dt, dt / inertia  # torque that stops a speed, speed that one makes
        outer, pace = position[i], velocity[i]
        angle = states[ROTOR_POSITION, i]
        speed = states[ROTOR_VELOCITY, i]
        torque_sum = 0.0
        current_sum = 0.0
        square_sum = 0.0
        for j in range(substeps):
            load = gear_torque(t, angle - (outer + pace * j * dt), speed - pace)
            current = motor_current(t, speed)
            motor = motor_torque(t, current)
            level = friction_level(t, speed, motor, -load)
            stop = -(halt * speed + motor - load)
            friction = min(level, max(-level, stop))
            speed += push * (motor - load + friction)
            angle += dt * speed
            torque_sum += load
            current_sum += current
            square_sum += current * current
        states[ROTOR_POSITION, i] = angle
        states[ROTOR_VELOCITY, i] = speed
        states[TORQUE, i] = torque_sum / substeps
        if params[CABLE_STIFFNESS, i] != 0.0:
            states[TORQUE, i] += cable_torque(params, i, position[i])
        states[CURRENT, i] = current_sum / substeps
        warm(arrays, i, winding_resistance(arrays, i) * square_sum / substeps, step_s)


@compiled
def move(
    arrays: Arrays,
    mount: Array,
    joints: Array,
    shafts: Array,
    tick_s: float,
    step_s: float,
    substeps: int,
) -> None:
    """One step of servos that sit at joints, preceded by a tick of their firmware if ``tick_s``.

    ``mount`` (2, servos): directions and zeros, ``joint = direction * servo + zero``. ``joints``
    (3, servos): angle [rad] and velocity [rad/s] at the beginning in, torque on the load [N m] out,
    in the joints' frame. ``shafts`` (3, servos) then holds angle, velocity and the winding's heat
    [K] at the beginning, in the servos' frame.
    """
    states = arrays.states
    for i in range(mount.shape[1]):
        shafts[0, i] = (joints[0, i] - mount[1, i]) * mount[0, i]
        shafts[1, i] = joints[1, i] * mount[0, i]
        shafts[2, i] = states[HEAT, i]
    if tick_s > 0.0:
        control(arrays, shafts[0], shafts[1], tick_s)
    drive(arrays, shafts[0], shafts[1], step_s, substeps)
    for i in range(mount.shape[1]):
        joints[2, i] = states[TORQUE, i] * mount[0, i]


class Jobs(NamedTuple):
    """What the jobs of one :func:`rollout` have to do; jobs of one recording share its events.

    ``number`` (groups, LANES) says which job a lane has; lanes without one come last and say -1.
    ``recording`` (jobs,) says which. ``events`` (n, 3) are time [s], field and value, ``samples``
    (n,) times [s], both ascending within a recording and from ``event_range`` and ``sample_range``
    (recordings + 1,). The torque of gravity is ``cos(q) gravity[0] - sin(q) gravity[1]`` with the
    columns of ``gravity`` (n, 2) from ``gravity_range`` (jobs + 1,), spread evenly over the job's
    time and interpolated; one row is a constant. ``end_s`` (recordings,) ends the rollout.
    """

    number: Integers
    recording: Integers
    events: Array
    event_range: Integers
    samples: Array
    sample_range: Integers
    gravity: Array
    gravity_range: Integers
    end_s: Array


@inlined
def drives(group: Array) -> Arrays:
    """The part of a group that :func:`drive` and :func:`control` know, too."""
    return Arrays(
        group[:OF_STATES],
        group[OF_STATES:OF_COMMANDS],
        group[OF_COMMANDS:OF_SUPPLIES],
        group[OF_SUPPLIES:OF_LOADS],
    )


@inlined
def rigid_gear(params: Array, i: int) -> bool:
    """Whether a rotor and its load are one mass."""
    return bool(math.isinf(params[GEAR_STIFFNESS, i]) and params[BACKLASH, i] == 0.0)


@compiled
def rollout(
    groups: Array,
    jobs: Jobs,
    tick_s: float,
    substeps: int,
    first: int,
    last: int,
    at: Integers,
    out: Array,
) -> None:
    """Run the groups ``first`` to ``last - 1``, each job from its start, into ``out[job, sample]``.

    ``groups`` (groups, ROWS, LANES): a lane is a job with a supply of its own. The rotor's inertia
    and a rigid gear (infinite stiffness) make one mass with the load. The gears of a group are all
    rigid or none is; so it is with friction that falls with velocity. ``at`` (PLACES, LANES) is
    written on. What a job gives depends on the job alone.
    """
    for g in range(first, last):
        live = begin(groups[g], jobs, jobs.number[g], tick_s, substeps, at)
        roll(groups[g], jobs, jobs.number[g], live, tick_s, substeps, at, out)


@compiled
def begin(
    group: Array, jobs: Jobs, number: Integers, tick_s: float, substeps: int, at: Integers
) -> int:
    """Put the lanes of one group at their jobs' beginnings; how many have a job."""
    params, states = drives(group).params, drives(group).states
    loads, lanes = group[OF_LOADS:OF_LANES], group[OF_LANES:]
    dt = tick_s / substeps
    live = 0
    for k in range(LANES):
        job = number[k]
        if job < 0:
            break
        live += 1
        recording = jobs.recording[job]
        end, skew = jobs.end_s[recording], loads[SAMPLE_SKEW, k]
        at[TICKS, k] = math.ceil((end + max(0.0, skew)) / tick_s) + 1
        at[EVENT, k] = jobs.event_range[recording]
        at[SEEN, k] = at[SAMPLE, k] = jobs.sample_range[recording]
        lanes[NEXT_EVENT, k] = lanes[NEXT_SEEN, k] = lanes[NEXT_SAMPLE, k] = -math.inf
        lanes[DUTY_DUE, k], lanes[DUTY_SHOWN, k] = loads[DUTY_PHASE, k], 0.0
        low = jobs.gravity_range[job]
        at[GRAVITIES, k] = jobs.gravity_range[job + 1] - low if end > 0.0 else 1
        lanes[COSINE, k], lanes[SINE, k] = jobs.gravity[low, 0], jobs.gravity[low, 1]
        states[ROTOR_POSITION, k] = loads[SHAFT_POSITION, k]
        states[ROTOR_VELOCITY, k] = loads[SHAFT_VELOCITY, k]
        inertia, load_inertia = params[ROTOR_INERTIA, k], loads[LOAD_INERTIA, k]
        if rigid_gear(params, k):
            inertia += load_inertia
        lanes[HALT, k], lanes[PUSH, k] = inertia / dt, dt / inertia  # as in drive()
        lanes[LOAD_HALT, k], lanes[LOAD_PUSH, k] = load_inertia / dt, dt / load_inertia
    return live


@compiled
def roll(  # noqa: PLR0912 - one tick, in loops that the compiler makes vectors of
    group: Array,
    jobs: Jobs,
    number: Integers,
    live: int,
    tick_s: float,
    substeps: int,
    at: Integers,
    out: Array,
) -> None:
    """Roll out one group, whose first ``live`` lanes have a job.

    What is different in every lane is done lane by lane, the rest in loops over all: lanes without
    a job or beyond its end go along, and nobody looks at them.
    """
    if group.shape[0] != ROWS or group.shape[1] != LANES:
        return  # never, but the compiler knows the shape from here on
    arrays, loads, lanes = drives(group), group[OF_LOADS:OF_LANES], group[OF_LANES:]
    params, states = arrays.params, arrays.states
    rigid, slow = rigid_gear(params, 0), falling(params, 0)
    dt = tick_s / substeps
    tick = 0
    while live > 0:
        now = tick * tick_s
        for k in range(live):
            if now >= lanes[NEXT_EVENT, k]:
                hear(arrays, jobs, number[k], k, now, lanes, at)
            if at[GRAVITIES, k] > 1:
                weigh(jobs, number[k], k, now, lanes)
            shaft = loads[SHAFT_POSITION, k]
            lanes[TICK_SENSED, k] = sense(params, k, shaft)
            lanes[TICK_COSINE, k], lanes[TICK_SINE, k] = math.cos(shaft), math.sin(shaft)
        for k in range(LANES):
            hang(params, loads, k, lanes)
            control_one(arrays, k, lanes[TICK_SENSED, k], lanes[TICK_VELOCITY, k], tick_s)
        for k in range(LANES):
            if now >= lanes[DUTY_DUE, k]:
                lanes[DUTY_SHOWN, k] = states[DUTY, k]
                lanes[DUTY_DUE, k] += loads[DUTY_REFRESH, k]
        for k in range(LANES):
            share_supply(arrays, k, k, k + 1)
        for k in range(LANES):
            lanes[VOLTS, k], lanes[CONDUCTANCE, k] = bridge(arrays, k)
            lanes[CURRENT_SUM, k], lanes[SQUARE_SUM, k] = 0.0, 0.0
        # the same each time; told what does not change, the compiler makes vectors of the last two
        if slow or live < FEW:
            turn(arrays, loads, lanes, live, dt, substeps, rigid, slow)
        elif rigid:
            turn(arrays, loads, lanes, LANES, dt, substeps, True, False)
        else:
            turn(arrays, loads, lanes, LANES, dt, substeps, False, False)
        for k in range(LANES):
            states[CURRENT, k] = lanes[CURRENT_SUM, k] / substeps
            power = winding_resistance(arrays, k) * lanes[SQUARE_SUM, k] / substeps
            warm(arrays, k, power, tick_s)
        for k in range(live):
            if min(lanes[NEXT_SEEN, k], lanes[NEXT_SAMPLE, k]) <= now + tick_s:
                show(arrays, loads, jobs, number[k], k, now, tick_s, lanes, at, out)
        tick += 1
        while live > 0 and at[TICKS, live - 1] <= tick:
            live -= 1


@inlined
def hear(
    arrays: Arrays, jobs: Jobs, job: int, k: int, now: float, lanes: Array, at: Integers
) -> None:
    """Let what a lane was told until now hold."""
    event, last_event = at[EVENT, k], jobs.event_range[jobs.recording[job] + 1]
    while event < last_event and jobs.events[event, 0] + arrays.params[DELAY, k] <= now:
        field = int(jobs.events[event, 1])
        if field >= SUPPLY_EVENT:
            arrays.supplies[field - SUPPLY_EVENT, k] = jobs.events[event, 2]
        else:
            arrays.commands[field, k] = jobs.events[event, 2]
        event += 1
    at[EVENT, k] = event
    lanes[NEXT_EVENT, k] = math.inf
    if event < last_event:
        lanes[NEXT_EVENT, k] = jobs.events[event, 0] + arrays.params[DELAY, k]


@inlined
def weigh(jobs: Jobs, job: int, k: int, now: float, lanes: Array) -> None:
    """Gravity on a lane's load that turns during its job."""
    low, rows = jobs.gravity_range[job], jobs.gravity_range[job + 1] - jobs.gravity_range[job]
    place = now / jobs.end_s[jobs.recording[job]] * (rows - 1)
    row = min(int(place), rows - 2)
    part = place - row
    row += low
    lanes[SINE, k] = (1.0 - part) * jobs.gravity[row, 1] + part * jobs.gravity[row + 1, 1]
    lanes[COSINE, k] = (1.0 - part) * jobs.gravity[row, 0] + part * jobs.gravity[row + 1, 0]


@inlined
def hang(params: Array, loads: Array, k: int, lanes: Array) -> None:
    """Where a shaft is when a tick begins, and what gravity and its cable pull there.

    Both are linear within a tick: a joint moves some mrad.
    """
    shaft, sin, cos = loads[SHAFT_POSITION, k], lanes[TICK_SINE, k], lanes[TICK_COSINE, k]
    sine, cosine = lanes[SINE, k], lanes[COSINE, k]
    lanes[TICK_POSITION, k], lanes[TICK_VELOCITY, k] = shaft, loads[SHAFT_VELOCITY, k]
    lanes[PULL, k] = cosine * cos - sine * sin + cable_torque(params, k, shaft)
    lanes[SLOPE, k] = -cosine * sin - sine * cos - params[CABLE_STIFFNESS, k]


@inlined
def turn(
    arrays: Arrays,
    loads: Array,
    lanes: Array,
    count: int,
    dt: float,
    substeps: int,
    rigid: bool,
    slow: bool,
) -> None:
    """Move the rotors and shafts of the first ``count`` lanes by one tick."""
    params, states = arrays.params, arrays.states
    for _ in range(substeps):
        for k in range(count):
            t = train(params, k, lanes[VOLTS, k], lanes[CONDUCTANCE, k], slow)
            angle, speed = states[ROTOR_POSITION, k], states[ROTOR_VELOCITY, k]
            shaft, pace = loads[SHAFT_POSITION, k], loads[SHAFT_VELOCITY, k]
            outer = lanes[PULL, k] + lanes[SLOPE, k] * (shaft - lanes[TICK_POSITION, k])
            current = motor_current(t, speed)
            motor = motor_torque(t, current)
            load = -outer
            if not rigid:
                load = gear_torque(t, angle - shaft, speed - pace)
            level = friction_level(t, speed, motor, -load)
            stop = -(lanes[HALT, k] * speed + motor - load)
            speed += lanes[PUSH, k] * (motor - load + min(level, max(-level, stop)))
            angle += dt * speed
            if rigid:
                shaft, pace = angle, speed
            else:
                bearing = loads[SHAFT_FRICTION, k]
                stop = -(lanes[LOAD_HALT, k] * pace + load + outer)
                held = min(bearing, max(-bearing, stop))
                pace += lanes[LOAD_PUSH, k] * (load + outer + held)
                shaft += dt * pace
            states[ROTOR_POSITION, k], states[ROTOR_VELOCITY, k] = angle, speed
            loads[SHAFT_POSITION, k], loads[SHAFT_VELOCITY, k] = shaft, pace
            lanes[CURRENT_SUM, k] += current
            lanes[SQUARE_SUM, k] += current * current


@inlined
def show(
    arrays: Arrays,
    loads: Array,
    jobs: Jobs,
    job: int,
    k: int,
    now: float,
    tick_s: float,
    lanes: Array,
    at: Integers,
    out: Array,
) -> None:
    """Put down the samples of a lane that are taken within a tick."""
    states = arrays.states
    recording = jobs.recording[job]
    first, last = jobs.sample_range[recording], jobs.sample_range[recording + 1]
    seen, skew = at[SEEN, k], loads[SAMPLE_SKEW, k]
    before, before_pace = lanes[TICK_SENSED, k], lanes[TICK_VELOCITY, k]
    after, pace = sense(arrays.params, k, loads[SHAFT_POSITION, k]), loads[SHAFT_VELOCITY, k]
    while seen < last and jobs.samples[seen] + skew <= now + tick_s:
        part = max(0.0, (jobs.samples[seen] + skew - now) / tick_s)
        row = out[job, seen - first]
        row[OUT_POSITION] = before + part * (after - before)
        row[OUT_VELOCITY] = before_pace + part * (pace - before_pace)
        seen += 1
    sample = at[SAMPLE, k]
    while sample < last and jobs.samples[sample] <= now + tick_s:
        row = out[job, sample - first]
        row[OUT_DUTY] = lanes[DUTY_SHOWN, k]
        row[OUT_VOLTAGE] = states[VOLTAGE, k]
        row[OUT_CURRENT] = states[CURRENT, k]
        row[OUT_HEAT] = states[HEAT, k] + states[WINDING_HEAT, k]
        sample += 1
    at[SEEN, k], at[SAMPLE, k] = seen, sample
    lanes[NEXT_SEEN, k] = jobs.samples[seen] + skew if seen < last else math.inf
    lanes[NEXT_SAMPLE, k] = jobs.samples[sample] if sample < last else math.inf


@compiled
def regulate(
    groups: Array,
    skew: Array,
    jobs: Jobs,
    sensed: Array,
    tick_s: float,
    first: int,
    last: int,
    out: Array,
) -> None:
    """Duty of some groups' controllers along given angles, into ``out`` (jobs, samples).

    ``sensed`` (jobs, samples) is what the servo showed at the job's samples, and sensed ``skew``
    (jobs) [s] after them; between those instants the shaft is taken to move evenly. What the motor
    makes of the duty plays no part.
    """
    for g in range(first, last):
        arrays = drives(groups[g])
        for k in range(LANES):
            job = jobs.number[g, k]
            if job >= 0:
                regulate_one(arrays, k, skew[job], jobs, sensed, tick_s, job, out)


@compiled
def regulate_one(
    arrays: Arrays,
    k: int,
    skew: float,
    jobs: Jobs,
    sensed: Array,
    tick_s: float,
    job: int,
    out: Array,
) -> None:
    """One job of :func:`regulate`."""
    params, commands = arrays.params, arrays.commands
    recording = jobs.recording[job]
    event, last_event = jobs.event_range[recording], jobs.event_range[recording + 1]
    first, last = jobs.sample_range[recording], jobs.sample_range[recording + 1]
    sample, seen, tick = first, first, 0
    while sample < last:
        now = tick * tick_s
        while event < last_event and jobs.events[event, 0] + params[DELAY, k] <= now:
            field = int(jobs.events[event, 1])
            if field < SUPPLY_EVENT:
                commands[field, k] = jobs.events[event, 2]
            event += 1
        angle, pace = sensed[job, seen - first], 0.0
        if seen > first:
            span = max(jobs.samples[seen] - jobs.samples[seen - 1], 1e-6)
            pace = (angle - sensed[job, seen - 1 - first]) / span
            angle -= pace * (jobs.samples[seen] + skew - now)
        control_one(arrays, k, angle, pace, tick_s)
        tick += 1
        while seen < last - 1 and jobs.samples[seen] + skew <= tick * tick_s:
            seen += 1
        while sample < last and jobs.samples[sample] <= tick * tick_s:
            out[job, sample - first] = arrays.states[DUTY, k]
            sample += 1
