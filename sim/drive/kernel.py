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
* or to :func:`sim.drive.lanes.rollout`, which moves a load of one joint itself, in the same
  substeps. There the gear may be rigid: rotor and load are then one mass, which allows much longer
  steps.

Motor: ``torque = k i / (1 + droop |i|)`` with ``i = (duty V - ke w) / R``; the droop of most is
0. With torque disabled the bridge is taken to be open: no current, no torque, friction stays
(assumed). A duty of 0 with torque enabled brakes.

Friction is a budget (Duclusaud et al., Extended Friction Models for the Physics Simulation of Servo
Actuators, 2025): the friction that would stop the rotor within the step, limited by a level, so
that a resting rotor rests. The level is their model M6; M1 to M5 are M6 with zeros. Before it
slips, friction may give way by a small angle, as a spring and a damper do (presliding: Dupont,
Hayward, Armstrong and Altpeter, IEEE Trans. Autom. Control 47(5), 2002); an angle of 0 is none.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiling import compiled, inlined
from .elementary import decay, sine_cosine

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
PARAMS = 47
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


#: how long the damper beside friction's spring takes to let it go [s]; assumed: a rotor of 0.004
#: kg m^2 that 0.05 N m hold with 1 mrad is then damped a little less than halfway to critical
LETS_GO_S = 0.004
LEAST = 1e-30  #: [rad] what a rotor without friction is divided by


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
    raised: bool  #: whether that is to another power than 1, which takes long
    stiffness: float
    damping: float
    half_backlash: float
    breakaway: float


@inlined
def falling(params: Array, i: int) -> bool:
    """Whether any term of a servo's friction falls with velocity."""
    found = False
    for field in FALLING:
        found |= params[field, i] != 0.0
    return found


@inlined
def is_raised(params: Array, i: int) -> bool:
    """Whether a servo's friction falls with another power of the velocity than 1."""
    return bool(params[STRIBECK_EXPONENT, i] != 1.0)


@inlined
def bridge(arrays: Arrays, i: int) -> tuple[float, float]:
    """Voltage at a winding [V] and its conductance [S], both 0 while the bridge is open."""
    closed = 1.0 if running(arrays, i) else 0.0
    volts = closed * arrays.states[DUTY, i] * arrays.states[VOLTAGE, i]
    return volts, closed / winding_resistance(arrays, i)


@inlined
def train(
    params: Array, i: int, volts: float, conductance: float, slow: bool, raised: bool
) -> Train:
    """One servo's drive train; see :func:`bridge`, :func:`falling` and :func:`is_raised`."""
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
        raised,
        params[GEAR_STIFFNESS, i],
        params[GEAR_DAMPING, i],
        0.5 * params[BACKLASH, i],
        params[BREAKAWAY, i],
    )


@inlined
def friction_level(t: Train, velocity: float, motor: float, external: float) -> float:
    """Largest friction torque [N m] at a velocity [rad/s], motor and external torque [N m]."""
    level = t.coulomb + t.viscous * abs(velocity)
    level += abs(t.load_motor * motor - t.load_external * external)
    if t.slow:
        slow = t.stribeck
        slow += abs(t.load_motor_stribeck * motor - t.load_external_stribeck * external)
        back = t.quadratic_motor * motor * motor
        ahead = t.quadratic_external * external * external
        more = ahead if abs(motor) > abs(external) else back
        slow += more if motor * external < 0.0 else 0.0
        ratio = abs(velocity) / t.stribeck_velocity
        if t.raised:
            ratio **= t.stribeck_exponent
        level += decay(ratio) * slow
    return float(level)


@inlined
def friction(t: Train, level: float, bent: float, stop: float, push: float, dt: float) -> float:
    """Friction of a rotor [N m] in a step of ``dt``, of which ``level`` is the largest there is.

    ``stop`` is the torque that would stop the rotor within the step [N m], ``push`` the speed that
    a torque makes in it [rad/(s N m)], ``bent`` how far friction has given way until now [rad].
    Spring and damper are implicit: they are those of the step's end.
    """
    give = push * level * (dt + LETS_GO_S)
    spring = level * bent + t.breakaway * stop
    held = stop - spring / max(t.breakaway + give, LEAST)
    return float(min(level, max(-level, held)))


@inlined
def bend(t: Train, bent: float, moved: float) -> float:
    """How far friction has given way [rad] after a rotor has moved on [rad]."""
    return float(min(t.breakaway, max(-t.breakaway, bent + moved)))


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
    torque = t.stiffness * twist + t.damping * twist_rate
    if t.half_backlash > 0.0:  # a flank pushes, and is never pulled at
        play = t.stiffness * t.half_backlash
        torque = max(0.0, torque - play) if twist > 0.0 else min(0.0, torque + play)
        if abs(twist) < t.half_backlash:
            torque = 0.0
    return float(torque)


@inlined
def hurry(arrays: Arrays, i: int, position: float, velocity: float, tick_s: float) -> None:
    """How fast a goal moves in the tick to come, where there is a limit of its acceleration.

    It brakes in time; one that is changed on the way is gone to from the speed there is. A servo
    that was not at it before starts from its sensed ``position``, or from its ``velocity``.
    """
    states, commands, params = arrays.states, arrays.commands, arrays.params
    swing = min(commands[ACCELERATION_LIMIT, i], params[ACCELERATION_CAP, i]) * tick_s
    if swing == math.inf:
        states[PACE, i] = math.inf
        return
    if commands[MODE, i] == MODE_VELOCITY:
        pace = states[PACE, i] if states[WAS_REGULATING, i] == 2.0 else velocity
        wanted = commands[GOAL_VELOCITY, i]
    else:
        going = states[WAS_REGULATING, i] == 1.0
        pace = states[PACE, i] if going else 0.0
        ahead = commands[GOAL_POSITION, i] - (states[RAMP, i] if going else position)
        way = abs(ahead) / tick_s
        # the pace from which so many ticks, each slower by a swing than the one before, end there
        ticks = max(1.0, math.ceil(0.5 * (math.sqrt(1.0 + 8.0 * way / swing) - 1.0)))
        stopping = way / ticks + 0.5 * swing * (ticks - 1.0)
        limit = min(commands[VELOCITY_LIMIT, i], params[VELOCITY_CAP, i])
        wanted = math.copysign(min(limit, stopping), ahead)
    pace = pace if pace < math.inf else 0.0
    states[PACE, i] = min(pace + swing, max(pace - swing, wanted))


@inlined
def position_law(arrays: Arrays, i: int, position: float, tick_s: float) -> float:
    """Duty of the position law at one tick, before the duty limit; moves ramp and integral."""
    states, commands = arrays.states, arrays.commands
    # both are read: a row that depends on the error could not be read for many lanes at once
    cw_gain, cw_margin = commands[GAIN_CW, i], commands[MARGIN_CW, i]
    ccw_gain, ccw_margin = commands[GAIN_CCW, i], commands[MARGIN_CCW, i]
    if states[WAS_REGULATING, i] != 1.0:
        states[RAMP, i] = position
        states[INTEGRAL, i] = 0.0
        states[LAST_POSITION, i] = position
    params = arrays.params
    reach = min(commands[VELOCITY_LIMIT, i], params[VELOCITY_CAP, i]) * tick_s
    ahead = commands[GOAL_POSITION, i] - states[RAMP, i]
    if states[PACE, i] < math.inf:
        states[RAMP, i] += states[PACE, i] * tick_s
    elif ahead > reach:
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
    punch = (1.0 - params[PUNCH_LEFT_OUT, i]) * commands[PUNCH, i] + params[PUNCH_MORE, i]
    duty = sign * (punch + gain * beyond) + states[INTEGRAL, i]
    moved = position - states[LAST_POSITION, i]
    damping = commands[DERIVATIVE_GAIN, i] * params[GAIN_SCALE, i]
    return float(duty - damping * moved / tick_s)


@inlined
def sense(params: Array, i: int, position: float) -> float:
    """What the position sensor makes of the output shaft's angle, both [rad]."""
    if params[WAVE, i] != 0.0:
        angle = params[WAVE_PERIODS, i] * position + params[WAVE_PHASE, i]
        position += params[WAVE, i] * sine_cosine(angle)[0]
    return float(position + params[ZERO_OFFSET, i])


@inlined
def control_one(arrays: Arrays, i: int, sensed: float, velocity: float, tick_s: float) -> None:
    """One tick of one servo's firmware: sets the duty that holds until the next tick.

    ``sensed`` is what :func:`sense` makes of the shaft's angle; :func:`hurry` comes before it.
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
        goal = states[PACE, i] if states[PACE, i] < math.inf else commands[GOAL_VELOCITY, i]
        duty = goal / params[VELOCITY_SCALE, i]
        duty += params[VELOCITY_GAIN, i] * (goal - velocity)
        regulating = 2.0
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
        sensed = sense(arrays.params, i, position[i])
        hurry(arrays, i, sensed, velocity[i], tick_s)
        control_one(arrays, i, sensed, velocity[i], tick_s)


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
        t = train(params, i, volts, conductance, falling(params, i), is_raised(params, i))
        inertia = params[ROTOR_INERTIA, i]
        halt, push = inertia / dt, dt / inertia  # torque that stops a speed, speed that one makes
        outer, pace = position[i], velocity[i]
        angle = states[ROTOR_POSITION, i]
        speed = states[ROTOR_VELOCITY, i]
        bent = states[BENT, i]
        torque_sum = 0.0
        current_sum = 0.0
        square_sum = 0.0
        for j in range(substeps):
            load = gear_torque(t, angle - (outer + pace * j * dt), speed - pace)
            current = motor_current(t, speed)
            motor = motor_torque(t, current)
            level = friction_level(t, speed, motor, -load)
            stop = -(halt * speed + motor - load)
            held = friction(t, level, bent, stop, push, dt)
            speed += push * (motor - load + held)
            angle += dt * speed
            bent = bend(t, bent, dt * speed)
            torque_sum += load
            current_sum += current
            square_sum += current * current
        states[ROTOR_POSITION, i] = angle
        states[ROTOR_VELOCITY, i] = speed
        states[BENT, i] = bent
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
