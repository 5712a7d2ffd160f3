"""The hidden world of one joint on MuJoCo: bodies, gear, dry friction, and the servo around them.

The rotor's dry friction is MuJoCo's own friction constraint, or bristles that bend before they
slip; its back-EMF is an implicit damping. Play is a second hinge that is free within its limits,
gear compliance a hinge with a spring: both lie between the rotor and the output shaft, where the
sensor sits. The firmware runs at its own period, the engine in substeps of it. At every tick it
measures the angle, in counts and with noise, and takes the goal that is there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from .bristles import Bristles
from .instant import TICK_S, Act, GateKind, Instant, Stage
from .specimen import Body, Specimen

Floats = NDArray[np.float64]

# Without it the engine would write its warnings into a file in the working directory.
mujoco.set_mju_user_warning(lambda _: None)

_UNSTABLE = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
]
SETTLE_S = 0.6  #: the first goal is held for so long before a recording starts
GRAVITY_M_S2 = 9.81
FINE_SUBSTEPS = 4  #: at least, where the gear is no rigid body
STIFF_RAD = 0.4  #: phase of the fastest spring in one substep
#: between a gear's spring and its play there must be a body: a small output gear; assumed
GEAR_INERTIA_KG_M2 = 1e-5
EDGE_RAD = 0.03  #: over which a sector of worn teeth begins
TIGHT_RAD = 1e-5
ROUNDING = 1e-9
SPECK_KG, SPECK_KG_M2 = 1e-6, 1e-9  #: the engine wants every moving body to have some mass


@dataclass(frozen=True)
class Commands:
    """What reaches the servo: goals and torque switch, at instants, and register values."""

    t_s: Floats  #: of the goals' arrival, ascending
    goal_rad: Floats
    end_s: float
    torque_off_s: float = math.inf
    registers: Mapping[str, int] = field(default_factory=dict)
    warm_s: float = 0.0
    start_rad: float | None = None  #: where the joint starts; else at the first goal


@dataclass(frozen=True)
class Trace:
    """The truth at every firmware tick; arrays of shape (ticks,)."""

    t_s: Floats
    position_rad: Floats
    sensed_rad: Floats  #: what the sensor says, before rounding and noise
    count: Floats  #: what the firmware measured, in steps of the sensor
    velocity_rad_s: Floats
    duty: Floats
    rail_v: Floats
    current_a: Floats
    temperature_c: Floats

    def last(self, at_s: Floats) -> NDArray[np.intp]:
        """The last tick at or before each instant; the first one before all."""
        return np.maximum(np.searchsorted(self.t_s, at_s, side="right") - 1, 0)


def roll(
    specimen: Specimen, commands: Commands, random: np.random.Generator | None = None
) -> Trace:
    """Run a specimen through commands, from ``SETTLE_S`` before 0 on.

    ``random`` is for the noise of what the firmware measures; there is none without it.
    """
    return _Rollout(specimen, commands, random).run()


class _Rollout:
    def __init__(
        self, specimen: Specimen, commands: Commands, random: np.random.Generator | None
    ) -> None:
        self.specimen, self.commands, self.random = specimen, commands, random
        self.model = model = mujoco.MjModel.from_xml_string(_document(specimen))
        self.data = mujoco.MjData(model)
        self.substeps = round(specimen.tick_s / model.opt.timestep)
        names = [model.joint(j).name for j in range(model.njnt)]
        self.inside = [j for j, name in enumerate(names) if name in ("shaft", "twist", "play")]
        self.play = names.index("play") if "play" in names else -1
        self.stages: dict[Stage, list[Act]] = {stage: [] for stage in Stage}
        for part in specimen.parts:
            self.stages[part.stage].append(part.start(commands.warm_s))

    def goals(self, t_s: Floats) -> list[float]:
        commands = self.commands
        arrived = commands.t_s + self.specimen.goal_late_s
        index = np.searchsorted(arrived, t_s + 1e-12, side="right") - 1
        values: list[float] = commands.goal_rad[np.maximum(index, 0)].tolist()
        return values

    def run(self) -> Trace:  # noqa: PLR0912, PLR0915  one tick, in its order, with no calls to spare
        specimen, commands = self.specimen, self.commands
        model, data, substeps = self.model, self.data, self.substeps
        tick_s = specimen.tick_s
        first, last = -round(SETTLE_S / tick_s), math.ceil(commands.end_s / tick_s)
        ticks = np.arange(first, last + 1, dtype=np.float64)
        t_s: Floats = (ticks + specimen.tick_phase) * tick_s
        goals = self.goals(t_s)
        noise = self.noise(len(t_s))
        law = specimen.sheet.law(commands.registers)
        gain = law.gain_per_rad * specimen.gain_factor
        margin, punch = law.margin_rad + specimen.margin_rad, law.punch + specimen.punch
        step_rad = specimen.sheet.step_rad
        k, ke = specimen.torque_constant_nm_a, specimen.back_emf_v_s_rad
        sense = _sensor(specimen)
        qpos, qvel, applied = data.qpos, data.qvel, data.qfrc_applied
        damping, dry, bias = model.dof_damping, model.dof_frictionloss, data.qfrc_bias
        inside, two = self.inside, len(self.inside) > 1
        goal_acts, duty_acts, limit_acts, supply_acts, friction_acts, load_acts = (
            self.stages[stage] for stage in Stage
        )
        now = Instant()
        now.tick_s = tick_s
        bristles = None
        if specimen.bristle_nm_rad > 0.0:
            step_s = float(model.opt.timestep)
            bristles = Bristles(specimen.bristle_nm_rad, specimen.armature_kg_m2, step_s)
            dry[0] = 0.0
        start = goals[0] if commands.start_rad is None else commands.start_rad
        qpos[0] = start + specimen.sensing.zero_rad
        off_tick = commands.torque_off_s
        mj_step = mujoco.mj_step
        duty = 0.0
        log: list[tuple[float, ...]] = []
        resistance = specimen.resistance_ohm
        for t, goal, off in zip(t_s.tolist(), goals, noise, strict=True):
            q0, v0 = qpos.item(0), qvel.item(0)
            q, v = q0, v0
            if two:
                for j in inside[1:]:
                    q += qpos.item(j)
                    v += qvel.item(j)
            now.t_s, now.position_rad, now.velocity_rad_s = t, q, v
            now.motor_velocity_rad_s = v0
            now.goal_rad = goal
            for act in goal_acts:
                act(now)
            shown = sense(q)
            count = round(shown / step_rad + off)
            now.sensed_rad = count * step_rad
            on = t < off_tick
            # position law
            now.skip_control = False
            now.gain_per_rad = gain
            error = now.goal_rad - now.sensed_rad
            now.error_rad = error
            beyond = abs(error) - margin
            now.duty = math.copysign(punch + gain * beyond, error) if beyond > 0.0 else 0.0
            for act in duty_acts:
                act(now)
            limit = specimen.duty_limit
            now.duty_limit = limit
            now.duty = min(max(now.duty, -limit), limit)
            for act in limit_acts:
                act(now)
            if now.skip_control:
                now.duty = duty
            on = on and now.duty_limit > 0.0
            duty = now.duty if on else 0.0
            now.duty = duty
            # supply and motor; an open bridge carries no current
            now.rail_v = specimen.supply_v - specimen.droop_v_s * max(t, 0.0)
            now.resistance_ohm = resistance
            now.current_a = (duty * now.rail_v - ke * v0) / resistance if on else 0.0
            for act in supply_acts:
                act(now)
            r = now.resistance_ohm
            damping[0] = specimen.viscous_nm_s_rad + (k * ke / r if on else 0.0)
            drive = k * duty * now.rail_v / r if on else 0.0
            now.current_a = (duty * now.rail_v - ke * v0) / r if on else 0.0
            now.motor_torque_nm = k * now.current_a
            now.external_torque_nm = -bias.item(0)
            now.load_nm = 0.0
            for act in load_acts:
                act(now)
            now.friction_nm = specimen.coulomb_nm
            for act in friction_acts:
                act(now)
            for j in inside:
                applied[j] = now.load_nm
            applied[0] = now.load_nm + drive
            if self.play >= 0 and specimen.gear.play_gate.kind is not GateKind.ALWAYS:
                self.set_play(q)
            log.append((q, shown, count, v, duty, now.rail_v, now.current_a))
            if bristles is None:
                dry[0] = max(now.friction_nm, 1e-6)
                mj_step(model, data, substeps)
                continue
            for _ in range(substeps):
                held = bristles.torque(qvel.item(0), now.friction_nm)
                applied[0] = now.load_nm + drive + held
                mj_step(model, data)
        return self.trace(t_s, log)

    def noise(self, ticks: int) -> list[float]:
        """Of what the firmware measures at every tick, in counts."""
        if self.random is None:
            return [0.0] * ticks
        values: list[float] = self.random.normal(
            scale=self.specimen.sensing.noise_steps, size=ticks
        ).tolist()
        return values

    def set_play(self, position_rad: float) -> None:
        gear = self.specimen.gear
        gate = gear.play_gate
        depth = min(position_rad - gate.low, gate.high - position_rad) / EDGE_RAD
        half = max(0.5 * gear.play_rad * min(max(depth, 0.0), 1.0), TIGHT_RAD)
        self.model.jnt_range[self.play] = (-half, half)

    def trace(self, t_s: Floats, log: list[tuple[float, ...]]) -> Trace:
        q, shown, count, v, duty, rail, current = np.array(log).T
        if not np.isfinite(q).all() or self.data.warning.number[_UNSTABLE].any():
            raise ArithmeticError(f"the engine became unstable: {self.specimen}")
        specimen = self.specimen
        heat_w = specimen.resistance_ohm * current**2
        # The board's sensor: a slow first order of the copper losses. 20 K/W and 100 s: assumed.
        rise = 20.0 / 100.0 * np.cumsum(heat_w) * specimen.tick_s
        warm = 12.0 * (1.0 - math.exp(-self.commands.warm_s / 100.0))
        board_c = specimen.ambient_c + 4.0 + warm + rise
        return Trace(t_s, q, shown, count, v, duty, rail, current, board_c)


def _sensor(specimen: Specimen) -> Any:
    """A magnet on the shaft over an angle sensor: off the axis, it reads wrong once a turn."""
    zero = specimen.sensing.zero_rad
    x, y = specimen.sensing.eccentric_x, specimen.sensing.eccentric_y
    if x == 0.0 and y == 0.0:
        return lambda q: q - zero
    sin, cos, atan2, remainder = math.sin, math.cos, math.atan2, math.remainder

    def eccentric(q: float) -> float:
        seen = atan2(sin(q) + y, cos(q) + x)
        return q + remainder(seen - q, 2.0 * math.pi) - zero

    return eccentric


@lru_cache(maxsize=256)
def _document_of(
    arm: Body,
    payload: tuple[float, float],
    armature: float,
    tilt: tuple[float, float, bool],
    gear: tuple[float, float, float],
    hung: tuple[float, ...],
    numerics: tuple[int, str, str],
    tick_s: float,
) -> str:
    play, stiffness, gear_damping = gear
    substeps, integrator, solver = numerics
    substeps = max(substeps, _fine(play, stiffness, armature))  # in TICK_S
    step_s = tick_s / math.ceil(substeps * tick_s / TICK_S - ROUNDING)
    side, across = GRAVITY_M_S2 * math.sin(tilt[1]), GRAVITY_M_S2 * math.sin(tilt[0])
    along = GRAVITY_M_S2 * math.cos(tilt[0]) * math.cos(tilt[1])
    gravity = (side, -along, -across) if tilt[2] else (side, -across, -along)
    speck = (
        f'<inertial pos="0 0 0" mass="{SPECK_KG}" '
        f'diaginertia="{SPECK_KG_M2} {SPECK_KG_M2} {SPECK_KG_M2}"/>'
    )
    wheel = (
        f'<inertial pos="0 0 0" mass="{SPECK_KG}" diaginertia="{GEAR_INERTIA_KG_M2} '
        f'{GEAR_INERTIA_KG_M2} {GEAR_INERTIA_KG_M2}"/>'
    )
    shaft = (
        f'<joint name="shaft" type="hinge" axis="0 1 0" armature="{armature!r}" damping="0" '
        f'frictionloss="1e-6" solreffriction="{2.0 * step_s!r} 1" '
        'solimpfriction="0.9999 0.9999 0.001"/>'
    )
    opened, closed = f'<body name="rotor">{shaft}', "</body>"
    if stiffness > 0.0:
        opened += f'{speck}<body name="gear"><joint name="twist" type="hinge" axis="0 1 0" '
        opened += f'stiffness="{stiffness!r}" damping="{gear_damping!r}"/>'
        closed += "</body>"
    if play > 0.0:
        # The grease of the teeth keeps the free part from rattling for ever; assumed.
        opened += f'{wheel if stiffness > 0.0 else speck}<body name="output">'
        opened += '<joint name="play" type="hinge" axis="0 1 0" damping="2e-4" limited="true" '
        opened += f'range="{-0.5 * play!r} {0.5 * play!r}" solreflimit="{2.0 * step_s!r} 1" '
        opened += 'solimplimit="0.99 0.9999 0.0001"/>'
        closed += "</body>"
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{step_s!r}" '
        f'integrator="{integrator}" solver="{solver}" '
        f'gravity="{gravity[0]!r} {gravity[1]!r} {gravity[2]!r}"><flag contact="disable"/></option>'
        f"<worldbody>{opened}{_arm(arm, payload, hung)}{closed}</worldbody></mujoco>"
    )


def _fine(play_rad: float, stiffness_nm_rad: float, armature_kg_m2: float) -> int:
    """Substeps of TICK_S that a gear needs: its spring turns by no more than STIFF_RAD in one."""
    if play_rad == 0.0 and stiffness_nm_rad == 0.0:
        return 1
    light = min(armature_kg_m2, GEAR_INERTIA_KG_M2 if play_rad > 0.0 else armature_kg_m2)
    return max(FINE_SUBSTEPS, math.ceil(math.sqrt(stiffness_nm_rad / light) * TICK_S / STIFF_RAD))


def _arm(arm: Body, payload: tuple[float, float], hung: tuple[float, ...]) -> str:
    """The arm, what is fixed on it, and what hangs from it."""
    mass, down = payload
    text = _inertial(arm)
    if mass > 0.0:
        text = (
            f'<body name="arm">{text}</body><body name="payload" pos="0 0 {-down!r}">'
            f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="1e-9 1e-9 1e-9"/></body>'
            f"{_empty()}"
        )
    if hung:
        hung_kg, length, at, damping = hung
        text += (
            f'<body name="hung" pos="0 0 {-at!r}"><joint name="pin" type="hinge" axis="0 1 0" '
            f'damping="{damping!r}"/><inertial pos="0 0 {-length!r}" mass="{hung_kg!r}" '
            'diaginertia="1e-7 1e-7 1e-7"/></body>'
        )
    return text


def _empty() -> str:
    return (
        f'<inertial pos="0 0 0" mass="{SPECK_KG}" '
        f'diaginertia="{SPECK_KG_M2} {SPECK_KG_M2} {SPECK_KG_M2}"/>'
    )


def _inertial(body: Body) -> str:
    x, y, z = body.com_m
    a, b, c = body.inertia_kg_m2
    return (
        f'<inertial pos="{x!r} {y!r} {z!r}" mass="{body.mass_kg!r}" '
        f'diaginertia="{a!r} {b!r} {c!r}"/>'
    )


def _document(specimen: Specimen) -> str:
    hung, gear, numerics = specimen.hung, specimen.gear, specimen.numerics
    return _document_of(
        specimen.arm,
        (specimen.payload_kg, specimen.payload_at_m),
        specimen.armature_kg_m2,
        (specimen.tilt_x_rad, specimen.tilt_y_rad, specimen.upright),
        (gear.play_rad, gear.stiffness_nm_rad, gear.damping_nm_s_rad),
        (hung.mass_kg, hung.length_m, hung.at_m, hung.damping_nm_s_rad) if hung else (),
        (numerics.substeps, numerics.integrator, numerics.solver),
        specimen.tick_s,
    )
