"""One servo drive: controller, motor, friction, gear, supply, heat. Compiled, over flat arrays.

The arrays are those of :mod:`sim.drive.fields`. Nothing here knows a physics engine or a robot: the
output shaft's angle and velocity come in, the torque of the shaft on its load goes out.

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

from .compiling import compiled, inlined
from .elementary import decay, sine_cosine
from .fields import (
    ACCELERATION_CAP,
    ACCELERATION_LIMIT,
    BACK_EMF,
    BACKLASH,
    BENT,
    BREAKAWAY,
    CABLE_REST,
    CABLE_STIFFNESS,
    COULOMB,
    CURRENT,
    CURRENT_CAP,
    DERIVATIVE_GAIN,
    DUTY,
    DUTY_CAP,
    DUTY_LIMIT,
    ENABLED,
    FALLING,
    GAIN_CCW,
    GAIN_CW,
    GAIN_SCALE,
    GEAR_DAMPING,
    GEAR_STIFFNESS,
    GOAL_DUTY,
    GOAL_POSITION,
    GOAL_VELOCITY,
    HEAT,
    HEAT_RESISTANCE,
    HEAT_TIME,
    INTEGRAL,
    INTEGRAL_GAIN,
    INTEGRAL_MORE,
    LAST_POSITION,
    LOAD_EXTERNAL,
    LOAD_EXTERNAL_STRIBECK,
    LOAD_MOTOR,
    LOAD_MOTOR_STRIBECK,
    MARGIN_CCW,
    MARGIN_CW,
    MARGIN_MORE,
    MODE,
    MODE_POSITION,
    MODE_VELOCITY,
    OVERLOAD_DUTY,
    OVERLOAD_TIME,
    OVERLOADED,
    PACE,
    PUNCH,
    PUNCH_LEFT_OUT,
    PUNCH_MORE,
    QUADRATIC_EXTERNAL,
    QUADRATIC_MOTOR,
    RAMP,
    RESISTANCE,
    RESISTANCE_RISE,
    ROTOR_INERTIA,
    ROTOR_POSITION,
    ROTOR_VELOCITY,
    SENSOR_STEP,
    STRIBECK,
    STRIBECK_EXPONENT,
    STRIBECK_VELOCITY,
    SUPPLY_RESISTANCE,
    SUPPLY_VOLTAGE,
    TORQUE,
    TORQUE_CONSTANT,
    TORQUE_DROOP,
    VELOCITY_CAP,
    VELOCITY_GAIN,
    VELOCITY_LIMIT,
    VELOCITY_SCALE,
    VISCOUS,
    VOLTAGE,
    WAS_REGULATING,
    WAVE,
    WAVE_PERIODS,
    WAVE_PHASE,
    WINDING_HEAT,
    WINDING_HEAT_RESISTANCE,
    WINDING_HEAT_TIME,
    ZERO_OFFSET,
    Array,
    Arrays,
)

#: how long the damper beside friction's spring takes to let it go [s]; assumed: a rotor of 0.004
#: kg m^2 that 0.05 N m hold with 1 mrad is then damped a little less than halfway to critical
LETS_GO_S = 0.004
LEAST = 1e-30  #: [rad] what a rotor without friction is divided by


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
