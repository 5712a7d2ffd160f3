"""One servo drive: its firmware, its rotor, and their supply, heat and cable. Compiled.

The arrays are those of :mod:`sim.drive.fields`. Nothing here knows a physics engine or a robot: the
output shaft's angle and velocity come in, the torque of the shaft on its load goes out.

Two masses. The rotor (:mod:`sim.drive.rotor`), with its inertia seen through the gear, is
integrated here in ``substeps`` short steps. Between it and the output shaft is the gear: a stiff
spring with damping and, if asked for, a dead zone. Position is sensed at the output shaft, as the
potentiometers of AX-12A and XL-320 do. The shaft and its load belong

* to a physics engine (:func:`drive`): the shaft is taken to move at constant velocity within one
  call. A rigid gear (infinite stiffness) is impossible there;
* or to :func:`sim.drive.lockstep.rollout`, which moves a load of one joint itself, in the same
  substeps. There the gear may be rigid: rotor and load are then one mass, which allows much longer
  steps.

With torque disabled the bridge is taken to be open: no current, no torque, friction stays
(assumed). A duty of 0 with torque enabled brakes.
"""

from __future__ import annotations

from ..compiling import compiled, inlined
from .fields import (
    BACK_EMF,
    BENT,
    CABLE_REST,
    CABLE_STIFFNESS,
    CURRENT,
    DUTY,
    HEAT,
    HEAT_RESISTANCE,
    HEAT_TIME,
    RESISTANCE,
    RESISTANCE_RISE,
    ROTOR_INERTIA,
    ROTOR_POSITION,
    ROTOR_VELOCITY,
    SUPPLY_RESISTANCE,
    SUPPLY_VOLTAGE,
    TORQUE,
    VOLTAGE,
    WINDING_HEAT,
    WINDING_HEAT_RESISTANCE,
    WINDING_HEAT_TIME,
    Array,
    Arrays,
)
from .firmware import control, running
from .rotor import (
    bend,
    falling,
    friction,
    friction_level,
    gear_torque,
    is_raised,
    motor_current,
    motor_torque,
    train,
)


@inlined
def bridge(arrays: Arrays, i: int) -> tuple[float, float]:
    """Voltage at a winding [V] and its conductance [S], both 0 while the bridge is open."""
    closed = 1.0 if running(arrays, i) else 0.0
    volts = closed * arrays.states[DUTY, i] * arrays.states[VOLTAGE, i]
    return volts, closed / winding_resistance(arrays, i)


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
