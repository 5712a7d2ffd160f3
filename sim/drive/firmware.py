"""One servo's firmware: the duty that it makes of commands and sensor, tick by tick. Compiled.

It has a law of the position, one of the velocity, or passes on a duty. Limits of velocity and
acceleration let a goal move, that of the duty holds for all; a drive that is overloaded shuts down.
The arrays are those of :mod:`sim.drive.fields`.
"""

from __future__ import annotations

import math

from ..compiling import compiled, inlined
from .elementary import sine_cosine
from .fields import (
    ACCELERATION_CAP,
    ACCELERATION_LIMIT,
    DERIVATIVE_GAIN,
    DUTY,
    DUTY_CAP,
    DUTY_LIMIT,
    ENABLED,
    GAIN_CCW,
    GAIN_CW,
    GAIN_SCALE,
    GOAL_DUTY,
    GOAL_POSITION,
    GOAL_VELOCITY,
    INTEGRAL,
    INTEGRAL_GAIN,
    INTEGRAL_MORE,
    LAST_POSITION,
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
    RAMP,
    SENSOR_STEP,
    VELOCITY_CAP,
    VELOCITY_GAIN,
    VELOCITY_LIMIT,
    VELOCITY_SCALE,
    WAS_REGULATING,
    WAVE,
    WAVE_PERIODS,
    WAVE_PHASE,
    ZERO_OFFSET,
    Array,
    Arrays,
)

#: share of a count that is none. A firmware works in counts, and at its goal it pushes nowhere;
#: here both are angles, and the step of a robot file is rounded: after ten turns they are a
#: thousandth of a count apart
EXACT = 0.01


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
    exact = EXACT * params[SENSOR_STEP, i]
    if beyond < -exact:
        return 0.0
    limit = min(commands[DUTY_LIMIT, i], params[DUTY_CAP, i])
    integral_gain = commands[INTEGRAL_GAIN, i] + params[INTEGRAL_MORE, i]
    total = states[INTEGRAL, i] + integral_gain * error * tick_s
    states[INTEGRAL, i] = min(limit, max(-limit, total))  # no wind-up beyond full duty
    punch = (1.0 - params[PUNCH_LEFT_OUT, i]) * commands[PUNCH, i] + params[PUNCH_MORE, i]
    push = sign * (punch + gain * beyond) if beyond > exact else 0.0
    duty = push + states[INTEGRAL, i]
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
