"""What a joint is by the numbers of a hypothesis: candidates for rollouts along its recordings.

Effects are put into the robot's description and nuisances into what comes of it, in the condition
that each recording was made under.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from busemu.tables import ServoMount
from sim.condition import under
from sim.one_joint import one_joint_load
from sim.robot import PhysicalRobot
from sim.rollout import Candidate, Load

from ..knobs import Knob, with_effects
from ..observed import Observed
from ..posture import arm_load
from .nuisances import Nuisance

Floats = NDArray[np.float64]

REMEMBERED = 500  #: candidates; a fit turns the nuisances of few


class Candidates:
    """What vectors make of one joint, number ``index`` of ``base``, in recordings of it."""

    def __init__(
        self,
        base: PhysicalRobot,
        mount: ServoMount,
        index: int,
        observed: Sequence[Observed],
    ) -> None:
        self._mount, self._index = mount, index
        self._postures = [o.posture_rad for o in observed]
        self._spans_s = [float(o.replay.samples[-1]) for o in observed]
        self._conditions = [tuple(sorted(o.condition.items(), key=str)) for o in observed]
        self._bases = {
            key: under(base, dict(o.condition))
            for key, o in zip(self._conditions, observed, strict=True)
        }
        self._made: dict[object, Candidate] = {}
        self._arm_loads: dict[object, Load] = {}

    def each(
        self,
        nuisances: Sequence[Nuisance],
        knobs: tuple[Knob, ...],
        z: Floats,
        which: Sequence[int],
        *,
        rigid: bool,
    ) -> list[Candidate]:
        """What a vector makes of the joint in some recordings: the same in those that are alike.

        It is that of the nuisances, then of the knobs. ``rigid`` makes rotor and load one mass.
        """
        made: dict[object, Candidate] = {}
        result = []
        for r in which:
            alike = self._conditions[r], self._arm(r)
            if alike not in made:
                candidate = self._with_effects(knobs, z[len(nuisances) :], r, rigid)
                made[alike] = _off(candidate, nuisances, z)
            result.append(made[alike])
        return result

    def _with_effects(self, knobs: tuple[Knob, ...], z: Floats, r: int, rigid: bool) -> Candidate:
        """Without nuisances: the same for many vectors, so the latest are remembered."""
        key = (knobs, z.tobytes(), self._conditions[r], self._arm(r), rigid)
        if key not in self._made:
            robot = with_effects(self._bases[self._conditions[r]], knobs, z.tolist())
            load = self._load(robot, r)
            payload = None
            if robot.payload is not None and robot.payload.mass_kg > 0.0:
                bare = replace(robot, payload=replace(robot.payload, mass_kg=0.0))
                heavy = robot.bodies[0].mass.mass_kg > 0.0
                payload = load.plus(self._load(bare, r), -1.0) if heavy else load
            if len(self._made) > REMEMBERED:
                self._made.clear()
            made = Candidate.of(robot, self._index, load, rigid=rigid)
            self._made[key] = replace(made, payload=payload)
        return self._made[key]

    def _load(self, robot: PhysicalRobot, r: int) -> Load:
        posture = self._postures[r]
        if posture is not None:
            key = (r, robot.bodies, robot.payload, robot.ground)
            if key not in self._arm_loads:
                if len(self._arm_loads) > REMEMBERED:
                    self._arm_loads.clear()
                self._arm_loads[key] = arm_load(robot, self._mount, posture, self._spans_s[r])
            return self._arm_loads[key]
        told = one_joint_load(robot)
        hangs = self._mount.to_servo(told.centre_rad)
        return Load.pendulum(told.inertia_kg_m2, told.gravity_nm, hangs, max(told.moment_nm, 1e-9))

    def _arm(self, r: int) -> int | None:
        """The recording itself, if other joints moved in it: then gravity is its own."""
        return None if self._postures[r] is None else r


def _off(candidate: Candidate, nuisances: Sequence[Nuisance], z: Floats) -> Candidate:
    """A candidate as far off what is believed as a vector that begins with nuisances has it."""
    candidate = replace(candidate, drive=candidate.drive.copy())
    for nuisance, x in zip(nuisances, z.tolist(), strict=False):
        if x != 0.0:
            candidate = nuisance.change(candidate, x * nuisance.deviation)
    return candidate
