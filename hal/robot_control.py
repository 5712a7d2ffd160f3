"""Robot control: joint angles in rad on one side, servos' registers on the other.

Everything a control cycle needs is worked out once, so a cycle costs a few array operations. One
rounding rule holds: round to the nearest count, then check the range; a goal outside raises.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from busemu.tables import Register, Robot

from .bus_client import BusClient
from .bus_errors import BusError, error_words, hardware_error_words

Angles = npt.NDArray[np.float64]

GOAL, PRESENT, TORQUE = "goal_position", "present_position", "torque_enable"
#: Speed limit in joint mode, where 0 means none; source: e-manual, AX-12A and XL-320, X series.
SPEED_LIMITS = ("moving_speed", "profile_velocity")
#: How often "torque off" is sent to servos that have not confirmed it; assumed.
TORQUE_OFF_ATTEMPTS = 3


class GoalRangeError(ValueError):
    """A goal that a joint's servo cannot take: names the joint, the goal and its bounds in rad."""


class RobotControl:
    """The joints of a robot over a bus.

    ``joints`` fixes the order of all arrays; by default that of the robot file.
    :attr:`lower_rad` and :attr:`upper_rad` bound the goals a servo takes, as joint angles.
    """

    def __init__(
        self, robot: Robot, client: BusClient, joints: Sequence[str] | None = None
    ) -> None:
        self.robot = robot
        self.client = client
        self.joints = tuple(joints) if joints is not None else tuple(robot.by_joint)
        missing = [joint for joint in self.joints if joint not in robot.by_joint]
        if missing:
            raise KeyError(f"{robot.name} has no joint {', '.join(missing)}")
        self._mounts = tuple(robot.by_joint[joint] for joint in self.joints)
        self.ids = tuple(mount.servo_id for mount in self._mounts)
        self._index = {joint: i for i, joint in enumerate(self.joints)}
        self._goal = self._places(GOAL)
        self._present = self._places(PRESENT)
        self._direction = np.array([float(mount.direction) for mount in self._mounts])
        self._zero_rad = np.array([mount.zero_rad for mount in self._mounts])
        self._goal_scale = np.array([place.si_scale for place in self._goal])
        self._goal_zero = np.array([float(place.zero) for place in self._goal])
        self._goal_low = np.array([float(place.minimum) for place in self._goal])
        self._goal_high = np.array([float(place.maximum) for place in self._goal])
        self._goal_coded = any(place.encoding != "unsigned" for place in self._goal)
        ends = [
            (bound - self._goal_zero) * self._goal_scale * self._direction + self._zero_rad
            for bound in (self._goal_low, self._goal_high)
        ]
        self.lower_rad: Angles = np.minimum(*ends)
        self.upper_rad: Angles = np.maximum(*ends)

    def set_goals(self, goals_rad: Mapping[str, float] | Sequence[float] | Angles) -> None:
        """Send goals with one sync_write: by joint name, or all in the order of :attr:`joints`.

        Raises :class:`GoalRangeError` before anything is sent, or what the client raises.
        """
        if isinstance(goals_rad, Mapping):
            chosen = np.array([self._index[joint] for joint in goals_rad], dtype=np.intp)
            goals = np.array(list(goals_rad.values()), dtype=float)
        else:
            chosen = np.arange(len(self.joints))
            goals = np.asarray(goals_rad, dtype=float)
            if goals.shape != chosen.shape:
                raise ValueError(f"{len(self.joints)} goals are needed, got {goals.shape}")
        servo_rad = self._direction[chosen] * (goals - self._zero_rad[chosen])
        counts = np.rint(servo_rad / self._goal_scale[chosen]) + self._goal_zero[chosen]
        good = (counts >= self._goal_low[chosen]) & (counts <= self._goal_high[chosen])
        if not good.all():
            worst = int(np.argmin(good))
            self._refuse(int(chosen[worst]), float(goals[worst]))
        numbers = chosen.tolist()
        raws = counts.astype(np.int64).tolist()
        if self._goal_coded:
            raws = [self._goal[i].encode(count) for i, count in zip(numbers, raws, strict=True)]
        ids = self.ids
        self.client.sync_write(GOAL, {ids[i]: raw for i, raw in zip(numbers, raws, strict=True)})

    def read_positions(self) -> Angles:
        """Present joint angles [rad] in the order of :attr:`joints`; NaN where the reply was lost.

        Raises :class:`PortLostError` if the port fails.
        """
        raws = self.client.read_all(PRESENT, self.ids)
        servo_rad = [
            math.nan if raw is None else place.to_si(raw)
            for raw, place in zip(raws.values(), self._present, strict=True)
        ]
        positions_rad: Angles = self._direction * np.array(servo_rad) + self._zero_rad
        return positions_rad

    def torque_on(self) -> None:
        """Switch the torque of every joint on, with one sync_write."""
        self.client.sync_write(TORQUE, dict.fromkeys(self.ids, 1))

    def torque_off(self) -> tuple[str, ...]:
        """Switch the torque of every joint off, read back, and send again where it did not take.

        Returns the joints that did not confirm. Never raises for the bus: it must be of use when
        the bus is failing.
        """
        pending = self.ids
        for _ in range(TORQUE_OFF_ATTEMPTS):
            try:
                self.client.sync_write(TORQUE, dict.fromkeys(pending, 0))
                states = self.client.read_all(TORQUE, pending)
            except BusError:
                continue
            pending = tuple(servo_id for servo_id, raw in states.items() if raw != 0)
            if not pending:
                break
        return tuple(self.robot.by_id[servo_id].joint for servo_id in pending)

    def unlimit_speed(self) -> None:
        """Take back any speed limit an earlier program left: 0 in joint mode is no limit."""
        for register in SPEED_LIMITS:
            ids = [i for i in self.ids if register in self.robot.tables[i]]
            if ids:
                self.client.sync_write(register, dict.fromkeys(ids, 0))

    def alerts(self) -> dict[str, str]:
        """Say what the servos complained of: words by joint, empty if nothing.

        On Protocol 2.0 the status packet carries one alert bit only: the servos that set it are
        asked for their ``hardware_error_status``.
        """
        found: dict[str, str] = {}
        for servo_id, bits in self.client.statistics.alert_bits.items():
            mount = self.robot.by_id[servo_id]
            words = error_words(bits, self.client.protocol)
            if "hardware_error_status" in self.robot.tables[servo_id]:
                try:
                    status = self.client.read(servo_id, "hardware_error_status")
                    words = hardware_error_words(status, mount.model) if status else words
                except BusError:
                    pass
            found[mount.joint] = words
        return found

    def _places(self, register: str) -> tuple[Register, ...]:
        tables = self.robot.tables
        return tuple(tables[servo_id][register] for servo_id in self.ids)

    def _refuse(self, index: int, goal_rad: float) -> None:
        raise GoalRangeError(
            f"{self.joints[index]}: goal {goal_rad:.4f} rad is outside "
            f"[{self.lower_rad[index]:.4f}, {self.upper_rad[index]:.4f}] rad"
        )
