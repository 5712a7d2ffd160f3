"""A plant made of a bank of drives and any engine that moves rigid bodies in equal steps.

Time runs on two grids that both start at 0: the engine's steps, and the firmware's ticks of 1 ms,
which always fall on a step. A command given after ``advance(t)`` waits for the first tick after
``t``. ``advance(t)`` simulates whole steps up to and including the one that contains ``t``, and
what is sampled lies between the two ends of that step. So a run depends only on the commands and
the instants they were given at, to the last bit, however often it is advanced.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from busemu.plant import DriveCommand, ServoState

from .drive import fields
from .drive.bank import EVERY, DriveBank, Fields, command_column
from .drive.fields import Array
from .shown import ShownDuty, ShownPosition
from .tree import PhysicalRobot
from .watch import WATCH_S, Contacts, Event, Watch

TICK_S = (
    0.001  #: period of the servo's control interrupt; source: measured on AX-12+ (ROBOTIS forum)
)
STEPS_PER_TICK = (1, 2, 4, 8)  #: the first that is stable; a plain hexapod takes the first of all
SUBSTEPS = 10  #: of the rotors within a step
LATE = list(fields.GOALS)  #: of a command's column, what comes late by the drive's delay
PROMPT = [field for field in range(fields.COMMANDS) if field not in fields.GOALS]
ON_GRID = 1e-6  #: share of a grid's spacing within which an instant counts as on the grid


class Engine(Protocol):
    """Rigid bodies behind the drives. Joints are in the order of the robot's servos."""

    def read(self, position_rad: Array, velocity_rad_s: Array) -> None:
        """Write the joints' angles and velocities (joint frame) into the two arrays."""

    def step(self, torque_nm: Array) -> None:
        """Apply joint torques (joint frame) over one step."""

    def observe(self) -> dict[str, float]:
        """What stands beside the robot: ``mocap/...`` and ``contact/...``."""

    def contacts(self) -> Contacts:
        """What touches what."""

    def lean_rad(self) -> float:
        """Angle between the trunk's z axis and the ground's normal [rad]; 0 on a fixed base."""

    def close(self) -> None:
        """Let go of the engine; may be called twice."""


def grid_index(to_s: float, spacing_s: float, *, up: bool) -> int:
    """Number of the grid point at or after (``up``) or at or before an instant."""
    exact = to_s / spacing_s
    near = round(exact)
    if abs(exact - near) <= ON_GRID:
        return near
    return math.ceil(exact) if up else math.floor(exact)


class SteppedPlant:
    """Satisfies :class:`busemu.plant.Plant` over an :class:`Engine`.

    ``steps_per_tick`` steps of the engine make one firmware tick. Between a servo's frame and its
    joint's stands ``joint = direction * servo + zero`` of the robot's file.
    """

    def __init__(
        self, robot: PhysicalRobot, engine: Engine, *, steps_per_tick: int, substeps: int
    ) -> None:
        self._names = tuple(joint.name for joint in robot.joints)
        self._index = {joint.servo_id: i for i, joint in enumerate(robot.joints)}
        self._frames = [(float(j.direction), j.zero_rad, j.drive.ambient_c) for j in robot.joints]
        self._engine = engine
        self._step_s = TICK_S / steps_per_tick
        self._steps_per_tick = steps_per_tick
        self._mount = np.array(
            [[direction for direction, _, _ in self._frames], [zero for _, zero, _ in self._frames]]
        )
        count = len(self._names)
        # the step that contains the present instant: its end in the joints' frame (angle, velocity,
        # torque during it), its beginning in the servos' (angle, velocity, heat)
        self._joints = np.zeros((3, count))
        self._shafts = np.zeros((3, count))
        self._joint_rad, self._joint_rad_s, self._torque_nm = self._joints
        engine.read(self._joint_rad, self._joint_rad_s)
        self.bank = DriveBank(
            [joint.drive for joint in robot.joints],
            (self._joint_rad - self._mount[1]) * self._mount[0],
            supply_voltage_v=robot.supply.voltage_v,
            supply_resistance_ohm=robot.supply.resistance_ohm,
            step_s=self._step_s,
            substeps=substeps,
            tick_s=TICK_S,
        )
        self._columns = [
            (self._joints[:, i], self._shafts[:, i], self.bank.states[:, i]) for i in range(count)
        ]
        self._shown: ShownPosition | None = None
        if ShownPosition.needed(robot, self.bank.params):
            self._shown = ShownPosition(robot, self.bank.params, self._step_s)
            self._shown.keep(0, (self._joint_rad - self._mount[1]) * self._mount[0])
        self._renewed: ShownDuty | None = None
        if robot.reading.load_refresh_s > 0.0:
            self._renewed = ShownDuty(robot.reading.load_refresh_s, count)
        self.reading = robot.reading
        self._delays_s = [joint.drive.delay_s for joint in robot.joints]
        self._waiting: deque[tuple[int, int, Fields, Array]] = deque()
        self._steps = 0
        self._reached_s = 0.0  # the end of the last step
        self._now_s = 0.0
        self._watch = Watch(frozenset(f"{leg.name}.tibia" for leg in robot.legs))
        self._watch_steps = round(WATCH_S / self._step_s)
        self._until_watch = self._watch_steps
        self._until_tick = 0

    @property
    def step_s(self) -> float:
        """The engine's step [s]."""
        return self._step_s

    def advance(self, to_s: float) -> None:
        """Simulate up to ``to_s`` [s since the plant was made]; ``ValueError`` when it is past."""
        if not to_s >= self._now_s:
            raise ValueError(f"a plant cannot go back from {self._now_s} s to {to_s} s")
        if to_s == self._now_s:
            return
        if to_s > self._reached_s:
            wanted = grid_index(to_s, self._step_s, up=True)
            while self._steps < wanted:
                self._step()
            self._reached_s = self._steps * self._step_s
        self._now_s = to_s

    def command(self, servo_id: int, command: DriveCommand) -> None:
        """Set what a drive shall do from the next tick on; its goal later by its delay."""
        i, column = self._index[servo_id], command_column(command)
        if self._delays_s[i] == 0.0:
            self._put(0.0, i, EVERY, column)
            return
        self._put(0.0, i, PROMPT, column)
        self._put(self._delays_s[i], i, LATE, column)

    def _put(self, late_s: float, i: int, which: Fields, column: Array) -> None:
        tick = grid_index(self._now_s + late_s, TICK_S, up=False) + 1
        place = len(self._waiting)
        while place and self._waiting[place - 1][0] > tick:  # only where delays differ
            place -= 1
        self._waiting.insert(place, (tick, i, which, column))

    def sample(self, servo_id: int) -> ServoState:
        """The state of one servo at exactly the instant last advanced to.

        Angle, velocity and temperature lie between the two ends of the step; torque and current
        are means over it, duty and voltage hold during it. Angle and duty are those shown.
        """
        i = self._index[servo_id]
        direction, zero, ambient = self._frames[i]
        joint, shaft, drive = self._columns[i]
        angle, rate, _ = joint.tolist()
        position, velocity, heat = shaft.tolist()
        state = drive.tolist()
        part = 1.0
        if self._steps:
            part = min(1.0, max(0.0, self._now_s / self._step_s - (self._steps - 1)))
        position += part * ((angle - zero) * direction - position)
        velocity += part * (rate * direction - velocity)
        if self._shown is not None:
            position = self._shown(i, self._now_s, position, velocity)
        return ServoState(
            position_rad=position,
            velocity_rad_s=velocity,
            duty=state[fields.DUTY] if self._renewed is None else self._renewed(i),
            torque_nm=state[fields.TORQUE],
            current_a=state[fields.CURRENT],
            voltage_v=state[fields.VOLTAGE],
            temperature_c=ambient + (heat + part * (state[fields.HEAT] - heat)),
        )

    @property
    def events(self) -> Sequence[Event]:
        """Falls, self-contacts and links on the ground since the start, in order of time."""
        return self._watch.events

    def observe(self) -> Mapping[str, float]:
        """What an outside observer sees at the end of the step that contains the instant.

        ``mocap/base_{x,y,z}_m`` and ``mocap/base_{roll,pitch,yaw}_rad`` of the trunk frame,
        ``contact/<leg>_n`` from the ground on a leg's tibia and foot, ``contact/trunk_n`` on all
        the rest of the robot, ``contact/self_n`` between its own links (normal forces summed),
        with ``contact/self/<joint>/<joint>_n`` for each pair that touches (named by the joints
        that move them);
        ``rig/<joint>_rad`` and ``rig/<joint>_nm`` in the joint's frame.
        """
        seen = self._engine.observe()
        for name, angle, torque in zip(
            self._names, self._joint_rad.tolist(), self._torque_nm.tolist(), strict=True
        ):
            seen[f"rig/{name}_rad"] = angle
            seen[f"rig/{name}_nm"] = torque
        return seen

    def close(self) -> None:
        """Let go of the engine; the plant must not be used afterwards."""
        self._engine.close()

    def _step(self) -> None:
        due = self._until_tick == 0
        if due:
            self._until_tick = self._steps_per_tick
            if self._waiting:
                self._hand_over(self._steps // self._steps_per_tick)
        self._until_tick -= 1
        self.bank.move(self._mount, self._joints, self._shafts, tick=due)
        self._engine.step(self._torque_nm)
        self._engine.read(self._joint_rad, self._joint_rad_s)
        self._steps += 1
        if self._shown is not None:
            self._shown.keep(self._steps, (self._joint_rad - self._mount[1]) * self._mount[0])
        if self._renewed is not None:
            self._renewed.keep(self._steps * self._step_s, self.bank.states[fields.DUTY])
        self._until_watch -= 1
        if self._until_watch == 0:
            self._until_watch = self._watch_steps
            self._look()

    def _hand_over(self, tick: int) -> None:
        """Give the drives the commands that act from this tick on."""
        while self._waiting and self._waiting[0][0] <= tick:
            _, i, which, column = self._waiting.popleft()
            on = column[fields.ENABLED] > 0.0 >= self.bank.commands[fields.ENABLED, i]
            if on and which is PROMPT:  # a drive that is switched on knows its goal at once
                which = EVERY
                self._forget(i, column)
            self.bank.command(i, column, which)

    def _forget(self, i: int, column: Array) -> None:
        """Drop goals of a drive that wait until the late part of a command."""
        last = next(k for k, waiting in enumerate(self._waiting) if waiting[3] is column)
        kept = [w for k, w in enumerate(self._waiting) if w[1] != i or k > last]
        self._waiting = deque(kept)

    def _look(self) -> None:
        powered = bool(self.bank.commands[fields.ENABLED].any())
        now_s = self._steps * self._step_s
        self._watch.look(now_s, self._engine.contacts(), self._engine.lean_rad(), powered)
