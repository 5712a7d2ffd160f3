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
from sim.drive import lanes
from sim.effects import catalogue
from sim.entries import Section
from sim.robot import PhysicalRobot
from sim.rollout import Candidate

from ..journal import Journal, code, digest
from ..knobs import SOFTER, TWINS, Knob
from ..noise import Block
from ..observed import Channel, Observed
from ..posture import lever_m
from .candidates import Candidates
from .instants import believed_refresh_s
from .nuisances import GEAR_LEVELS, LOAD_OF_GEAR, PUNCH, has_punch, nuisances
from .recorded import Recorded
from .sways import WAYS, both_ways, swings

Floats = NDArray[np.float64]

LATEST = 8  #: vectors whose residuals are remembered: a fit often asks again for one it has tried
#: of the gain, and of the instants of the angles that a controller's duty is worked out along
TURNING = frozenset({"gain", "read_skew", PUNCH})
GEARS = frozenset({"backlash", "joint_compliance"})  #: which are about a gear that is a spring
#: effects beside which it matters what friction knows of the load
LOADED = frozenset({"load_friction", "directional_load_friction"})
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
        self._loaded = base.joints[self.index].drive.friction.of_load
        self.robot = robot
        self.table = robot.tables[self.mount.servo_id]
        if load_refresh_s is None:
            load_refresh_s = believed_refresh_s(robot, joint)
        self._load_refresh_s = load_refresh_s  #: period in which the duty's register is renewed
        self._candidates = Candidates(base, self.mount, self.index, observed)
        self._recorded = Recorded(self.observed, load_refresh_s, leash_rad_s)
        self._controllers = {
            n for n, e in catalogue().items() if e.enters == "controller"
        } | TURNING
        self._latest: dict[object, Blocks] = {}
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
        if not (self._loaded or LOADED & set(hypothesis.effects)):
            idle.add(LOAD_OF_GEAR)
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
        return self._each(hypothesis, z, [r])[0]

    def _each(self, hypothesis: Hypothesis, z: Floats, which: Sequence[int]) -> list[Candidate]:
        knobs, rigid = hypothesis.knobs, self.rigid(hypothesis)
        return self._candidates.each(self.nuisances, knobs, z, which, rigid=rigid)

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
        candidates = [c for z in vectors for c in self._each(hypothesis, z, which)]
        replays = which * len(vectors)
        outs = self._run(hypothesis, candidates, replays)
        duties: list[Floats] = []
        if Kind.DUTY in kinds:
            duties = self._recorded.regulate(candidates, replays)
        result: list[Blocks] = [{} for _ in vectors]
        for k, r in enumerate(which):
            these = range(k, len(candidates), len(which))
            some = [candidates[j] for j in these]
            out = np.stack([outs[j] for j in these])
            duty = np.stack([duties[j] for j in these]) if duties else None
            for kind in kinds:
                blocks = self._recorded.blocks(r, kind.channel, some, out, duty)
                for found, block in zip(result, blocks, strict=bool(blocks)):
                    found[r, kind] = self._swaying(r, block) if kind is Kind.POSITION else block
        return result

    def _swaying(self, r: int, block: Block) -> Block:
        return replace(block, sways=self._sways[r]) if self._sways[r].any() else block

    @cached_property
    def _sways(self) -> list[Floats]:
        """What every recording's positions may be swayed by (n, sways), as the joint is believed.

        Under a voltage that was recorded, no other sways it.
        """
        which = range(len(self.observed))
        null = Hypothesis()
        believed = self._each(null, np.zeros(len(self.nuisances)), which)
        swayed = [one for candidate in believed for one in both_ways(candidate)]
        outs = self._run(null, swayed, np.repeat(which, WAYS).tolist())
        found = []
        for r in which:
            these = slice(r * WAYS, (r + 1) * WAYS)
            out = np.stack(outs[these])
            blocks = self._recorded.blocks(r, Channel.POSITION, swayed[these], out, None)
            found.append(swings(blocks))
        return found

    def _run(
        self, hypothesis: Hypothesis, candidates: Sequence[Candidate], replays: Sequence[int]
    ) -> list[Floats]:
        """Rollouts, under the recorded supply where there is one.

        If its source is in question and no other servo draws on it, they are under that.
        """
        self.rollouts += len(candidates)
        sourced = SOURCE in hypothesis.effects and len(self.robot.servos) == 1
        return self._recorded.run(candidates, replays, sourced and not self.register_rules)

    def duty(self, hypothesis: Hypothesis, z: Floats, r: int) -> tuple[Floats, Floats]:
        """Times [s] and sizes of the duty that a vector makes of one recording."""
        (out,) = self._run(hypothesis, [self.candidate(hypothesis, z, r)], [r])
        return self._recorded.replays[r].samples, np.abs(out[:, lanes.OUT_DUTY])

    def law(self, found: Hypothesis, z: Floats, r: int, every_s: float) -> Floats:
        """The duty that firmware made of the recorded angles, every so many seconds from 0 on."""
        return self._recorded.law(self.candidate(found, z, r), r, every_s)

    def between(self, r: int, t_s: Floats) -> Floats:
        """How far a duty may be off, as angles are known now and then: :meth:`Left.between`."""
        return self._recorded.between(r, t_s)

    def floors(self) -> Mapping[Kind, float]:
        """The least white deviation of every kind that was observed: its register's rounding."""
        floors = {kind: self._recorded.floor(kind.channel) for kind in Kind}
        return {kind: floor for kind, floor in floors.items() if floor is not None}
