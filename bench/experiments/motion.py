"""Moving a robot through an experiment by its own software, slowly and with everything read back.

The torque goes on where the joints are and off at the end, whatever happens.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from busemu.tables import Robot
from hal.robot_control import Angles, RobotControl
from hal.walk import (
    SILENT_CYCLES,
    BusSilentError,
    first_positions,
)

from ..running import Session
from .experiment import ExperimentError, Progress
from .position_error import LAW_REGISTERS

#: Slow registers (voltage, shutdown, load) are read this often [s]; the servo renews its load
#: every 130 ms (the thesis's figure 2).
SLOW_EVERY_S = 0.1


class Motion:
    """The joints of a robot under way.

    Positions of ``watched`` joints are read in every cycle, as fast as the bus allows, and the
    registers ``slow`` of their servos, where they have them, ten times a second.
    """

    def __init__(
        self,
        session: Session,
        watched: Sequence[str],
        progress: Progress,
        slow: Sequence[str] = (),
    ) -> None:
        self.clock = session.clock
        self.client = session.client
        self.control = RobotControl(session.robot, session.client)
        self._watched = RobotControl(session.robot, session.client, watched)
        self._robot = session.robot
        self._progress = progress
        self._began_s = self._slow_due_s = session.clock.now_s()
        self._silent = 0
        tables = session.robot.tables
        self._slow = [(name, [i for i in self._watched.ids if name in tables[i]]) for name in slow]
        first_rad = first_positions(self.control).tolist()
        self.goals_rad = dict(zip(self.control.joints, first_rad, strict=True))
        self.law_registers = read_law(session, watched)  #: raw, by joint and name

    def go(self, goals_rad: Mapping[str, float], seconds: float, *, smooth: bool = True) -> None:
        """Move joints to goals [rad] within ``seconds``: starting and ending gently, or evenly."""
        start = {joint: self.goals_rad[joint] for joint in goals_rad}
        began_s = self.clock.now_s()
        share = 0.0
        while share < 1.0:
            share = min((self.clock.now_s() - began_s) / seconds, 1.0)
            way = share * share * (3.0 - 2.0 * share) if smooth else share
            self.cycle({j: start[j] + way * (goals_rad[j] - start[j]) for j in goals_rad})

    def hold(self, seconds: float) -> None:
        """Stay where the goals are for ``seconds``, reading."""
        until_s = self.clock.now_s() + seconds
        while self.clock.now_s() < until_s:
            self.cycle({})

    def cycle(self, goals_rad: Mapping[str, float]) -> Angles:
        """One cycle: these goals [rad], if any, out, and the watched joints' angles [rad] in."""
        if goals_rad:
            self.control.set_goals(goals_rad)
            self.goals_rad.update(goals_rad)
        positions = self._watched.read_positions()
        self._silent = self._silent + 1 if np.isnan(positions).all() else 0
        if self._silent >= SILENT_CYCLES:
            raise BusSilentError(
                f"no servo answered for {SILENT_CYCLES} cycles: check supply and wiring"
            )
        now_s = self.clock.now_s()
        if now_s >= self._slow_due_s:
            self._slow_due_s = now_s + SLOW_EVERY_S
            for register, ids in self._slow:
                self.client.read_all(register, ids)
        self._progress(now_s - self._began_s)
        return positions

    def torque_on(self) -> None:
        """Switch the torque on where the joints are; :class:`ExperimentError` if one refuses."""
        control = self.control
        control.unlimit_speed()
        control.set_goals(self.goals_rad)
        control.torque_on()
        off = [
            f"{self._robot.by_id[servo_id].joint} (servo {servo_id})"
            for servo_id, raw in self.client.read_all("torque_enable", control.ids).items()
            if raw == 0
        ]
        if off:
            raise ExperimentError(
                f"the torque of {', '.join(off)} does not go on: a servo that has shut down needs "
                "its supply switched off and on; then run the same command again"
            )


@contextmanager
def moving(
    session: Session, watched: Sequence[str], progress: Progress, slow: Sequence[str] = ()
) -> Iterator[Motion]:
    """A robot with its torque on; off again at the end, also after Ctrl-C or a failing bus."""
    motion = Motion(session, watched, progress, slow)
    try:
        motion.torque_on()
        yield motion
    except BaseException as error:
        left_on = _let_go(motion.control)
        if left_on:
            error.add_note(f"torque off was not confirmed by {', '.join(left_on)}: cut the supply")
        raise
    left_on = _let_go(motion.control)
    if left_on:
        raise ExperimentError(
            f"torque off was not confirmed by {', '.join(left_on)}: cut the supply"
        )


def _let_go(control: RobotControl) -> tuple[str, ...]:
    """Torque off, even if a second Ctrl-C comes."""
    try:
        return control.torque_off()
    except KeyboardInterrupt:
        return control.torque_off()


def read_law(session: Session, joints: Sequence[str]) -> dict[str, dict[str, int]]:
    """Read the registers that make the joints' position laws; raw values by joint and name."""
    robot = session.robot
    ids = [robot.by_joint[joint].servo_id for joint in joints]
    found: dict[str, dict[str, int]] = {joint: {} for joint in joints}
    for register in LAW_REGISTERS:
        there = [servo_id for servo_id in ids if register in robot.tables[servo_id]]
        for servo_id, raw in session.client.read_all(register, there).items() if there else ():
            if raw is not None:
                found[robot.by_id[servo_id].joint][register] = raw
    return found


def shutdown_registers(robot: Robot) -> tuple[str, ...]:
    """The registers that a shutdown of this robot's servos sets to 0."""
    return tuple(sorted({str(t.drive["shutdown_cuts"]) for t in robot.tables.values()}))


def load_register(robot: Robot, joint: str) -> str:
    """The register that shows the duty of a joint's servo: its load, or its PWM."""
    table = robot.tables[robot.by_joint[joint].servo_id]
    return "present_load" if "present_load" in table else "present_pwm"


def observe(session: Session, every_s: float, names: Callable[[str], bool]) -> None:
    """Have what stands beside an emulated robot recorded, of the names that are wanted.

    Where the bus is not in this process there is nobody beside the robot, and nothing happens.
    """
    bus = session.bus
    if bus is None:
        return

    def look(now_s: float) -> None:
        for name, value in bus.plant.observe().items():
            if names(name):
                session.recorder.observe(now_s, name, value)

    bus.every(every_s, look)
