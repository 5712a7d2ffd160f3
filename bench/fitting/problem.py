"""What is fitted to what: recordings, the numbers that are free, and a ledger of the error."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.diagnosis.joint.model import Blocks, Hypothesis, JointModel, Kind
from bench.diagnosis.knobs import Knob
from bench.diagnosis.observed import Channel, Observed, Samples, observe
from bench.importers import open_recordings
from bench.importers.bam_loop import TRAJECTORIES
from bench.recording import RecordingError
from busemu.plant import DriveCommand
from busemu.tables import Robot, load_robot
from sim.drive import fields
from sim.drive.bank import command_column
from sim.effects import effect
from sim.robot import PhysicalRobot, read_physics
from sim.rollout import Candidate, Replay

Floats = NDArray[np.float64]

ROBOT, JOINT = "xl330-pendulum", "arm"
#: numbers that are free, parameters of the catalogue's effects over the robot file's: the box, and
#: what the truth of simulated recordings is drawn from (assumed). The box is bam's for an XL330
#: (1.0.2: levels of 0 to 0.2 N m, 0 to 1 N m s/rad, 1e-4 to 0.05 kg m^2, +-0.1 rad, 0 to 0.5), the
#: catalogue's for the motor's two constants, which are bam's kt and R
NUMBERS: Mapping[str, tuple[float, float, float, float]] = MappingProxyType(
    {
        "torque_constant": (0.3, 3.0, 0.8, 1.25),
        "back_emf": (0.5, 2.0, 0.9, 1.1),
        "rotor_inertia": (0.06, 30.0, 0.6, 2.4),
        "coulomb_friction": (-0.02, 0.18, -0.01, 0.02),
        "viscous_friction": (-0.00325, 1.0, 0.0, 0.015),
        "zero_offset": (-0.1, 0.1, -0.03, 0.03),
        "load_friction": (0.0, 0.5, 0.1, 0.25),
    }
)
#: how many of these a model has
MODELS: Mapping[str, int] = MappingProxyType({"M1": 6, "M3": 7})
MOTIONS = ("sin_sin", "sin_time_square", "up_and_down")
FITTED_KP, JUDGED_KP = 400, 100  #: of simulated recordings, as in the public logs
PERIOD_S, DURATION_S = 0.005, 6.0  #: of simulated recordings, as in the public logs
CONDITION = MappingProxyType({"payload_kg": 0.49, "payload_at_m": 0.1, "supply_v": 7.4})


#: is told vectors and their residuals
Watch = Callable[[Sequence[Floats], Sequence[Floats]], None]


def unseen(vectors: Sequence[Floats], residuals: Sequence[Floats]) -> None:
    """Nobody watches."""


class SameModel(JointModel):
    """One joint whose only numbers are the knobs of a hypothesis; positions alone are compared.

    ``watch`` is told every vector that somebody has asked for, and its residuals [rad].
    """

    def __init__(self, base: PhysicalRobot, robot: Robot, observed: Sequence[Observed]) -> None:
        super().__init__(base, robot, observed)
        self.nuisances = ()
        self.watch: Watch = unseen

    def residuals(
        self,
        hypothesis: Hypothesis,
        vectors: Sequence[Floats],
        which: Sequence[int] | None = None,
        kinds: Sequence[Kind] = tuple(Kind),
    ) -> list[Blocks]:
        """Residual blocks of positions for every vector."""
        found = super().residuals(hypothesis, vectors, which, (Kind.POSITION,))
        self.watch(vectors, [together(blocks) for blocks in found])
        return found


def together(blocks: Blocks) -> Floats:
    """All residuals of a vector, one recording after another [rad], shape (n,)."""
    return np.concatenate([block.value for block in blocks.values()])


@dataclass(frozen=True, slots=True)
class Plain:
    """What a candidate is in one recording, as numbers any simulator can take; servo frame, SI.

    Motor torque is ``stall_nm duty - emf_nm_s w``, ``duty = gain (goal - angle - zero)`` within
    ``limit``; gravity is ``cosine_nm cos q - sine_nm sin q``.
    """

    stall_nm: float  #: torque of full duty at standstill
    emf_nm_s: float
    gain: float
    limit: float
    inertia_kg_m2: float
    rotor_kg_m2: float
    coulomb_nm: float
    viscous_nm_s: float
    load: float  #: share of the torque through the gear that is friction
    sine_nm: float
    cosine_nm: float
    zero_rad: float
    start_rad: float  #: of the shaft
    start_rad_s: float

    @classmethod
    def of(cls, candidate: Candidate, replay: Replay) -> Plain:
        """Read a candidate."""
        drive, load = candidate.drive, candidate.load
        strength = float(drive[fields.TORQUE_CONSTANT] / drive[fields.RESISTANCE])
        zero = float(drive[fields.ZERO_OFFSET])
        return cls(
            strength * candidate.voltage_v,
            strength * float(drive[fields.BACK_EMF]),
            float(replay.start[fields.GAIN_CCW]),
            float(replay.start[fields.DUTY_LIMIT]),
            load.inertia_kg_m2,
            float(drive[fields.ROTOR_INERTIA]),
            float(drive[fields.COULOMB]),
            float(drive[fields.VISCOUS]),
            float(drive[fields.LOAD_MOTOR]),
            float(load.sine_nm[0]),
            float(load.cosine_nm[0]),
            zero,
            replay.position_rad - zero,
            replay.velocity_rad_s,
        )


@dataclass(frozen=True, eq=False)
class Problem:
    """Recordings to fit and to judge, and the numbers that are free; vectors are of their knobs."""

    name: str
    fitted: SameModel
    judge: SameModel
    hypothesis: Hypothesis
    truth: Floats | None = None

    @property
    def box(self) -> tuple[Floats, Floats]:
        """The least and the greatest vector."""
        ends = np.array([knob.bounds for knob in self.hypothesis.knobs])
        return ends[:, 0], ends[:, 1]

    @property
    def start(self) -> Floats:
        """The robot file's numbers."""
        return np.clip(np.zeros(len(self.hypothesis.knobs)), *self.box)


def believed(robot: Robot) -> PhysicalRobot:
    """The file's robot with only what all three simulators have.

    No effects, a stiff supply, a cold winding, and a controller that sees the angle unrounded.
    """
    base = read_physics(robot)
    joints = tuple(
        replace(j, drive=replace(j.drive, sensor_step_rad=0.0, resistance_rise_per_k=0.0))
        for j in base.joints
    )
    return replace(base, joints=joints, supply=replace(base.supply, resistance_ohm=0.0))


def hypothesis_of(model: str) -> Hypothesis:
    """The free numbers of a model of :data:`MODELS`, each within its box."""
    knobs = []
    for name, (low, high, *_) in list(NUMBERS.items())[: MODELS[model]]:
        (parameter,) = effect(name).parameters
        knobs.append(Knob(name, replace(parameter, low=low, high=high)))
    return Hypothesis(tuple(knobs))


def simulated(model: str, seed: int, duration_s: float = DURATION_S) -> Problem:
    """Recordings of our own rollouts, rounded as the servo's register, of a truth that is drawn."""
    robot = load_robot(ROBOT)
    base = believed(robot)
    hypothesis = hypothesis_of(model)
    random = np.random.default_rng(seed)
    truth = [knob.at(float(random.uniform(*NUMBERS[knob.effect][2:]))) for knob in hypothesis.knobs]
    models = []
    for kp in (FITTED_KP, JUDGED_KP):
        drafts = [_draft(robot, kp, motion, duration_s) for motion in MOTIONS]
        blocks = SameModel(base, robot, drafts).residuals(hypothesis, [np.array(truth)])[0]
        told = []
        for r, one in enumerate(drafts):
            counts = np.round(-blocks[r, Kind.POSITION].value / one.position.quantum)
            seen = replace(one.position, value=counts * one.position.quantum)
            told.append(replace(one, channels={Channel.POSITION: seen}))
        models.append(SameModel(base, robot, told))
    return Problem(f"simulated, {model}", models[0], models[1], hypothesis, np.array(truth))


def _draft(robot: Robot, kp: int, motion: str, duration_s: float) -> Observed:
    """What one recording would be whose positions are all 0."""
    table = robot.tables[robot.by_joint[JOINT].servo_id]
    gain = kp * float(table.drive["position_p_gain_duty_per_rad"])
    t_s: Floats = np.arange(0.0, duration_s, PERIOD_S)
    seen_s, goals = t_s + 0.5 * PERIOD_S, TRAJECTORIES[motion](t_s)
    command = DriveCommand(
        torque_enable=True,
        goal_position_rad=float(goals[0]),
        gain_cw_per_rad=gain,
        gain_ccw_per_rad=gain,
    )
    events = np.stack([t_s, np.full_like(t_s, fields.GOAL_POSITION), goals], axis=1)
    place, step = np.arange(len(t_s)), table["present_position"].si_scale
    samples = Samples("present_position", seen_s, 0.0 * t_s, step, place, np.isfinite(t_s))
    return Observed(
        name=f"{motion}-{kp}",
        group=f"{motion}-{kp}",
        joint=JOINT,
        condition=CONDITION,
        replay=Replay(command_column(command), events, seen_s, 0.0),
        channels={Channel.POSITION: samples},
        goal=(t_s, goals),
        registers={"position_p_gain": kp},
    )


def recorded(model: str, folder: Path) -> Problem:
    """The public logs of an XL330 whose torque stays on: the greatest gain fitted, others judge.

    Raises :class:`RecordingError` and ``OSError``.
    """
    robot = load_robot(ROBOT)
    base = believed(robot)
    told = observe(open_recordings([folder]), robot, JOINT, supply_from_register=False)
    told = [
        replace(one, channels={Channel.POSITION: one.position})
        for one in told
        if not (one.replay.events[:, 1] == fields.ENABLED).any()
    ]
    most = max((one.registers["position_p_gain"] for one in told), default=0)
    fitted = [one for one in told if one.registers["position_p_gain"] == most]
    judge = [one for one in told if one.registers["position_p_gain"] != most]
    if not fitted or not judge:
        raise RecordingError(folder, "there are no logs of two gains whose torque stays on")
    models = [SameModel(base, robot, part) for part in (fitted, judge)]
    return Problem(f"XL330 logs, {model}", models[0], models[1], hypothesis_of(model))


class OutOfTimeError(Exception):
    """A fit has had all its time."""


class Reached(NamedTuple):
    """The best error so far, and the time and the processor time of all threads it had taken."""

    error: float  #: as the way counts it [rad]
    rmse: float  #: root mean square there [rad]
    wall_s: float
    cpu_s: float


@dataclass(slots=True)
class Ledger:
    """The error reached against the time spent, of one fit; raises :class:`OutOfTimeError`."""

    limit_s: float  #: of processor time
    absolute: bool  #: whether mean absolute errors are what is minimised, else squares
    tell: Callable[[float], None] = lambda _: None
    line: list[Reached] = field(default_factory=list)
    seen: set[bytes] = field(default_factory=set)
    best: Floats = field(default_factory=lambda: np.zeros(0))
    begun: tuple[float, float] = field(
        default_factory=lambda: (time.perf_counter(), time.process_time())
    )

    @property
    def candidates(self) -> int:
        """How many vectors were tried, each counted once."""
        return len(self.seen)

    def now(self, errors: tuple[float, float]) -> Reached:
        """Mean absolute error and root mean square, reached now."""
        wall_s, cpu_s = self.begun
        error = errors[not self.absolute]
        return Reached(error, errors[1], time.perf_counter() - wall_s, time.process_time() - cpu_s)

    def note(self, vectors: Sequence[Floats], residuals: Sequence[Floats]) -> None:
        """Note some candidates and their residuals."""
        self.seen |= {z.tobytes() for z in vectors}
        for z, residual in zip(vectors, residuals, strict=True):
            now = self.now(mae_rmse(residual))
            if not self.line or now.error < self.line[-1].error:
                self.line.append(now)
                self.best = z.copy()
                self.tell(now.error)
        if time.process_time() - self.begun[1] > self.limit_s:
            raise OutOfTimeError

    def reached(self, error: float) -> Reached:
        """When an error [rad] was reached first, or the best one if it never was."""
        return next((one for one in self.line if one.error <= error), self.line[-1])


def mae_rmse(residual: Floats) -> tuple[float, float]:
    """Mean absolute error and root mean square."""
    return float(np.mean(np.abs(residual))), float(np.sqrt(np.mean(residual**2)))
