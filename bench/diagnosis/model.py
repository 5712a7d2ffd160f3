"""From what a robot may be to residuals: replays, run again under a hypothesis.

Residuals come in blocks, one a recording and kind, so that the path from a goal to a motion is
judged in parts:

* **position**: the whole path; where a voltage register was read often, under the recorded voltage,
  but of a hypothesis with a source of its own under that: a register shows what a voltage was;
* **duty**: the duty or load register against the firmware's law along the *recorded* angles: the
  controller alone;
* **voltage**: the voltage register against the supply of the hypothesis under the current it has.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from sim.condition import under
from sim.drive import fields, lanes
from sim.effects import catalogue
from sim.entries import Section
from sim.one_joint import one_joint_load
from sim.robot import PhysicalRobot
from sim.rollout import Batch, Candidate, Load

from .commands import without_supply
from .instants import believed_refresh_s, located, looked_back
from .journal import Journal, code, digest
from .knobs import SOFTER, TWINS, Knob, with_effects
from .leash import path
from .left import Left, good, runs_away
from .noise import Block
from .nuisances import GEAR_LEVELS, PUNCH, has_punch, nuisances
from .observed import Channel, Observed
from .posture import arm_load, lever_m
from .sways import SWAYS

Floats = NDArray[np.float64]

REMEMBERED = 500  #: candidates; a fit turns the nuisances of few
LATEST = 8  #: vectors whose residuals are remembered: a fit often asks again for one it has tried
#: of the gain, and of the instants of the angles that a controller's duty is worked out along
TURNING = frozenset({"gain", "read_skew", PUNCH})
GEARS = frozenset({"backlash", "joint_compliance"})  #: which are about a gear that is a spring
SOURCE = "voltage_sag"  #: which makes the voltage of a replay itself


class Kind(enum.Enum):
    """Kinds of residuals, in the order they are shown."""

    POSITION = "position"
    DUTY = "duty"
    VOLTAGE = "voltage"

    @property
    def channel(self) -> Channel:
        """The channel it is a residual of."""
        return Channel[self.name]


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """Effects that are on, by their knobs; nuisances always are."""

    knobs: tuple[Knob, ...] = ()

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, sorted, each once."""
        return tuple(sorted({knob.effect for knob in self.knobs}))

    def __add__(self, knobs: tuple[Knob, ...]) -> Hypothesis:
        return Hypothesis((*self.knobs, *knobs))

    def without(self, effect: str) -> Hypothesis:
        """The hypothesis with one effect off."""
        return Hypothesis(tuple(k for k in self.knobs if k.effect != effect))


Blocks = dict[tuple[int, Kind], Block]


class JointModel:
    """One joint of a rig in some recordings; residuals for any values of nuisances and knobs.

    A vector ``z`` is the nuisances in the order of :attr:`nuisances`, then the hypothesis's knobs.
    ``sprung`` makes the gear the spring that the robot file has; else rotor and load are one mass,
    but in hypotheses about the gear. ``leash_rad_s`` is that of :mod:`.leash`; 0 is none. With
    ``register_rules`` replays are under a recorded voltage even in hypotheses about the source.
    """

    def __init__(
        self,
        base: PhysicalRobot,
        robot: Robot,
        observed: Sequence[Observed],
        journal: Journal | None = None,
        load_refresh_s: float | None = None,
        *,
        sprung: bool = False,
        leash_rad_s: float = 0.0,
        register_rules: bool = False,
    ) -> None:
        self.base, self.sprung, self.leash_rad_s = base, sprung, leash_rad_s
        self.register_rules = register_rules
        self.journal = journal  #: of steps that are done, if they are kept
        self.observed = tuple(observed)
        joint = observed[0].joint
        self.mount = robot.by_joint[joint]
        self.index = next(i for i, j in enumerate(base.joints) if j.name == joint)
        self.recorded_supply = tuple(o.supplied for o in observed)
        told = Section(robot.path, "", robot.document)
        bodies = told.sections("body") if "body" in told else ()
        body = next((b for b in bodies if b.table.get("name") == joint), None)
        drive = told.section("drive").section(self.mount.model)
        law = str(robot.tables[self.mount.servo_id].drive.get("law"))
        lost = base.joints[self.index].drive.lost_at_stall
        self.nuisances = nuisances(drive, body, lever_m(base, joint), law, lost)
        self._punched = any(has_punch(o.replay.start, *o.replay.events.T[1:]) for o in observed)
        self.robot = robot
        self.table = robot.tables[self.mount.servo_id]
        if load_refresh_s is None:
            load_refresh_s = believed_refresh_s(robot, joint)
        self._load_refresh_s = load_refresh_s  #: period in which the duty's register is renewed
        self._conditions = [tuple(sorted(o.condition.items(), key=str)) for o in observed]
        self._bases = {
            key: under(base, dict(o.condition))
            for key, o in zip(self._conditions, observed, strict=True)
        }
        duties = [located(o, Channel.DUTY, load_refresh_s) for o in observed]
        volts = [located(o, Channel.VOLTAGE, o.volts_s) for o, _ in duties]
        #: with registers at the instants they were made
        self._shown = [looked_back(one) for one, _ in volts]
        paths = [path(o) if leash_rad_s else None for o in self._shown]
        self._replays = [
            replace(o.replay, path=way) for o, way in zip(self._shown, paths, strict=True)
        ]
        self._batch = Batch(self._replays)
        self._sensed = [
            np.interp(o.replay.samples, o.position.t_s[o.position.good], good(o))
            for o in self._shown
        ]
        self._left = [
            Left(one, renewed=bool(load_refresh_s) and at is None, made_s=at or 0.0, rail_s=rail)
            for one, (_, rail), (_, at) in zip(self._shown, volts, duties, strict=True)
        ]
        self._controllers = {
            n for n, e in catalogue().items() if e.enters == "controller"
        } | TURNING
        self._made: dict[object, Candidate] = {}
        self._latest: dict[object, Blocks] = {}
        self._arm_loads: dict[object, Load] = {}
        self.rollouts = 0  #: how many were run so far

    @cached_property
    def key(self) -> str:
        """A hash of all that residuals depend on: the code, the robot, what was observed."""
        return digest(
            code(),
            self.base,
            self.mount,
            self._load_refresh_s,
            self.sprung,
            self.leash_rad_s,
            self.register_rules,
            [(n.name, n.deviation, n.ends) for n in self.nuisances],
            *(part for one in self.observed for part in one.parts()),
        )

    def beside(self, other: JointModel) -> JointModel:
        """The same joint in the recordings of this model and of another of it."""
        observed = (*self.observed, *other.observed)
        return self.of(observed)

    def of(self, observed: Sequence[Observed], *, sprung: bool = False) -> JointModel:
        """The same joint in other recordings; ``sprung``: with the gear of its file at last."""
        return self._with(observed, sprung=sprung or self.sprung)

    def led(self, leash_rad_s: float) -> JointModel:
        """The same joint, its replays led along the recorded angles on a leash."""
        return self._with(self.observed, leash_rad_s=leash_rad_s)

    def ruled(self) -> JointModel:
        """The same joint, its replays under the recorded voltage in every hypothesis."""
        return self._with(self.observed, register_rules=True)

    def _with(self, observed: Sequence[Observed], **other: Any) -> JointModel:
        known = self.base, self.robot, observed, self.journal, self._load_refresh_s
        own = {
            "sprung": self.sprung,
            "leash_rad_s": self.leash_rad_s,
            "register_rules": self.register_rules,
        }
        return JointModel(*known, **(own | other))

    def rigid(self, hypothesis: Hypothesis) -> bool:
        """Whether rotor and load are one mass."""
        return not self.sprung and not GEARS & set(hypothesis.effects)

    def idle(self, hypothesis: Hypothesis) -> set[str]:
        """Names of nuisances that are an effect's own, or do nothing, in a hypothesis."""
        idle = {TWINS[name] for name in hypothesis.effects if name in TWINS}
        if self.rigid(hypothesis):
            idle |= GEAR_LEVELS
        if PUNCH in hypothesis.effects or not self._punched:
            idle.add(PUNCH)
        if SOFTER in hypothesis.effects:
            idle.add("gear_stiffness")
        return idle

    def turns_controller(self, hypothesis: Hypothesis, k: int) -> bool:
        """Whether number ``k`` of a vector is one that the controller's duty depends on."""
        if k < len(self.nuisances):
            return self.nuisances[k].name in TURNING
        return hypothesis.knobs[k - len(self.nuisances)].effect in self._controllers

    def candidate(self, hypothesis: Hypothesis, z: Floats, r: int) -> Candidate:
        """What a vector makes of the joint in one recording."""
        candidate = self._with_effects(hypothesis, z[len(self.nuisances) :], r)
        candidate = replace(candidate, drive=candidate.drive.copy())
        for nuisance, x in zip(self.nuisances, z.tolist(), strict=False):
            if x != 0.0:
                candidate = nuisance.change(candidate, x * nuisance.deviation)
        return candidate

    def _with_effects(self, hypothesis: Hypothesis, z: Floats, r: int) -> Candidate:
        """Without nuisances: the same for many vectors, so the latest are remembered."""
        key = (hypothesis.knobs, z.tobytes(), self._conditions[r], self._arm(r))
        if key not in self._made:
            robot = with_effects(self._bases[self._conditions[r]], hypothesis.knobs, z.tolist())
            load = self._load(robot, r)
            payload = None
            if robot.payload is not None and robot.payload.mass_kg > 0.0:
                bare = replace(robot, payload=replace(robot.payload, mass_kg=0.0))
                heavy = robot.bodies[0].mass.mass_kg > 0.0
                payload = load.plus(self._load(bare, r), -1.0) if heavy else load
            rigid = self.rigid(hypothesis)
            if len(self._made) > REMEMBERED:
                self._made.clear()
            made = Candidate.of(robot, self.index, load, rigid=rigid)
            self._made[key] = replace(made, payload=payload)
        return self._made[key]

    def _load(self, robot: PhysicalRobot, r: int) -> Load:
        posture = self.observed[r].posture_rad
        if posture is not None:
            key = (r, robot.bodies, robot.payload, robot.ground)
            if key not in self._arm_loads:
                if len(self._arm_loads) > REMEMBERED:
                    self._arm_loads.clear()
                self._arm_loads[key] = arm_load(robot, self.mount, posture)
            return self._arm_loads[key]
        told = one_joint_load(robot)
        hangs = self.mount.to_servo(told.centre_rad)
        return Load.pendulum(told.inertia_kg_m2, told.gravity_nm, hangs, max(told.moment_nm, 1e-9))

    def residuals(
        self,
        hypothesis: Hypothesis,
        vectors: Sequence[Floats],
        which: Sequence[int] | None = None,
        kinds: Sequence[Kind] = tuple(Kind),
    ) -> list[Blocks]:
        """Residual blocks (recorded less modelled) of some recordings, for every vector."""
        which = list(range(len(self.observed)) if which is None else which)
        keys = [(hypothesis.knobs, z.tobytes(), tuple(which), tuple(kinds)) for z in vectors]
        latest = {key: self._latest[key] for key in keys if key in self._latest}
        new = [z for key, z in zip(keys, vectors, strict=True) if key not in latest]
        made = iter(self._residuals(hypothesis, new, which, kinds) if new else ())
        result = [latest[key] if key in latest else next(made) for key in keys]
        if len(vectors) <= LATEST:
            kept = self._latest | dict(zip(keys, result, strict=True))
            self._latest = dict(list(kept.items())[-LATEST:])
        return result

    def _residuals(
        self,
        hypothesis: Hypothesis,
        vectors: Sequence[Floats],
        which: list[int],
        kinds: Sequence[Kind],
    ) -> list[Blocks]:
        candidates = [c for z in vectors for c in self._candidates(hypothesis, z, which)]
        replays = which * len(vectors)
        outs = self._run(hypothesis, candidates, replays)
        duties: list[Floats] = []
        if Kind.DUTY in kinds:
            duties = self._batch.regulate(candidates, replays, [self._sensed[r] for r in replays])
        result: list[Blocks] = [{} for _ in vectors]
        for k, r in enumerate(which):
            these = range(k, len(candidates), len(which))
            some = [candidates[j] for j in these]
            out = np.stack([outs[j] for j in these])
            duty = np.stack([duties[j] for j in these]) if duties else None
            for kind in kinds:
                blocks = self._blocks(r, kind, some, out, duty)
                for found, block in zip(result, blocks, strict=bool(blocks)):
                    found[r, kind] = self._swaying(r, block) if kind is Kind.POSITION else block
        return result

    def _blocks(
        self, r: int, kind: Kind, some: Sequence[Candidate], out: Floats, duty: Floats | None
    ) -> list[Block]:
        """A block of recording ``r`` for each candidate, of its rollout; none if it has no kind."""
        source = np.array([c.source_ohm for c in some])
        voltage = np.array([c.voltage_v for c in some])
        late = np.array([c.drive[fields.DELAY] for c in some])
        return self._left[r].blocks(kind.channel, out, duty, source, voltage, late)

    def _swaying(self, r: int, block: Block) -> Block:
        return replace(block, sways=self._sways[r]) if self._sways[r].any() else block

    @cached_property
    def _sways(self) -> list[Floats]:
        """What every recording's positions may be swayed by (n, sways), as the joint is believed.

        Under a voltage that was recorded, no other sways it.
        """
        which = range(len(self.observed))
        believed = self._candidates(Hypothesis(), np.zeros(len(self.nuisances)), which)
        ways = [(sway, side) for sway in SWAYS for side in (1.0, -1.0)]
        swayed = [sway(candidate, side) for candidate in believed for sway, side in ways]
        outs = self._run(Hypothesis(), swayed, np.repeat(which, len(ways)).tolist())
        found = []
        for r in which:
            these = slice(r * len(ways), (r + 1) * len(ways))
            blocks = self._blocks(r, Kind.POSITION, swayed[these], np.stack(outs[these]), None)
            sways = np.zeros((len(blocks[0].value) if blocks else 0, len(SWAYS)))
            if blocks and not runs_away(dict(enumerate(blocks))):
                sways = np.stack(
                    [
                        (b.value - a.value) / 2.0
                        for a, b in zip(blocks[::2], blocks[1::2], strict=True)
                    ],
                    axis=1,
                )
            found.append(sways)
        return found

    def _candidates(
        self, hypothesis: Hypothesis, z: Floats, which: Sequence[int]
    ) -> list[Candidate]:
        """What a vector makes of the joint in some recordings: the same in those that are alike."""
        made: dict[object, Candidate] = {}
        result = []
        for r in which:
            alike = self._conditions[r], self._arm(r)
            if alike not in made:
                made[alike] = self.candidate(hypothesis, z, r)
            result.append(made[alike])
        return result

    def _arm(self, r: int) -> int | None:
        """The recording itself, if other joints moved in it: then gravity is its own."""
        return None if self.observed[r].posture_rad is None else r

    def _run(
        self, hypothesis: Hypothesis, candidates: Sequence[Candidate], replays: Sequence[int]
    ) -> list[Floats]:
        """Rollouts, under the recorded supply where there is one.

        If its source is in question and no other servo draws on it, they are under that.
        """
        self.rollouts += len(candidates)
        own = SOURCE in hypothesis.effects and len(self.robot.servos) == 1
        if own and any(self.recorded_supply) and not self.register_rules:
            return list(self._sourced.run(candidates, replays, self.leash_rad_s))
        stiff = [
            replace(c, source_ohm=0.0) if self.recorded_supply[r] and c.source_ohm else c
            for c, r in zip(candidates, replays, strict=True)
        ]
        return list(self._batch.run(stiff, replays, self.leash_rad_s))

    @cached_property
    def _sourced(self) -> Batch:
        """Replays without what a register told of a supply that was recorded."""
        told = zip(self._replays, self.recorded_supply, strict=True)
        return Batch([without_supply(one) if recorded else one for one, recorded in told])

    def duty(self, hypothesis: Hypothesis, z: Floats, r: int) -> tuple[Floats, Floats]:
        """Times [s] and sizes of the duty that a vector makes of one recording."""
        (out,) = self._run(hypothesis, [self.candidate(hypothesis, z, r)], [r])
        return self._shown[r].replay.samples, np.abs(out[:, lanes.OUT_DUTY])

    def law(self, found: Hypothesis, z: Floats, r: int, every_s: float) -> Floats:
        """The duty that firmware made of the recorded angles, every so many seconds from 0 on."""
        replay, position = self.observed[r].replay, self.observed[r].position
        t_s: Floats = np.arange(0.0, replay.end_s + every_s, every_s)
        angles = np.interp(t_s, position.t_s[position.good], good(self.observed[r]))
        batch = Batch([replace(replay, samples=t_s)], threads=1)
        duty: Floats = batch.regulate([self.candidate(found, z, r)], [0], [angles])[0]
        return duty

    def between(self, r: int, t_s: Floats) -> Floats:
        """How far a duty may be off, as angles are known now and then: :meth:`Left.between`."""
        return self._left[r].between(t_s)

    def floors(self) -> Mapping[Kind, float]:
        """The least white deviation of every kind that was observed: its register's rounding."""
        floors: dict[Kind, float] = {}
        for kind in Kind:
            steps = [
                o.channels[kind.channel].quantum
                for o in self.observed
                if kind.channel in o.channels
            ]
            if steps:
                floors[kind] = max(steps) / np.sqrt(12.0)
        return floors
