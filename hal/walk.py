"""A walk: stand up, walk for some seconds at the rate the bus allows, and always let go.

The same code runs on a real bus and on a virtual one: all time comes from the clock given.
"""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .bus_errors import BusError
from .clock import Clock
from .cpg import LocomotionController
from .robot_control import Angles, RobotControl

#: Time to get from any posture to the neutral one [s]; assumed: slow enough for AX-12A and XL-320.
STAND_UP_S = 1.5
#: Cycle while standing up [s]; assumed.
STAND_UP_CYCLE_S = 0.02
#: The controller is never advanced further than this in one cycle [s], so that after a stall of the
#: bus the legs go on instead of leaping. Assumed.
LONGEST_ADVANCE_S = 0.1
#: A walk ends this much early [s], so that rounding of the clock does not add a cycle. Assumed.
END_TOLERANCE_S = 1e-6
#: Attempts at reading every joint before anything moves; assumed.
FIRST_READ_ATTEMPTS = 3
#: Cycles without a single reply after which the bus counts as dead; assumed.
SILENT_CYCLES = 3


class JointSilentError(BusError):
    """Joints that do not answer before the start: names them. Nothing was switched on."""


class BusSilentError(BusError):
    """No servo answers any more in the middle of a walk."""


@dataclass(slots=True)
class WalkReport:
    """What a walk was like. Cycle times in s, of the walking itself, not of standing up."""

    cycles: int = 0
    walked_s: float = 0.0
    cycle_mean_s: float = float("nan")
    cycle_median_s: float = float("nan")
    cycle_max_s: float = float("nan")
    missed_deadlines: int = 0
    lost_replies: int = 0  #: positions that did not come, or came damaged, over the whole run
    errors: dict[str, int] = field(default_factory=dict)  #: failures by kind, in words
    clipped_goals: int = 0  #: goals held at the bound of a joint
    alerts: dict[str, str] = field(default_factory=dict)  #: joint -> what its servo complained of
    tracking_rms_rad: dict[str, float] = field(default_factory=dict)  #: goal less position
    torque_left_on: tuple[str, ...] = ()  #: joints that did not confirm "torque off"


class WalkInterrupted(KeyboardInterrupt):
    """Ctrl-C during a walk: the torque is off, and ``report`` tells of the walk so far."""

    def __init__(self, report: WalkReport) -> None:
        super().__init__("the walk was interrupted")
        self.report = report


Steering = Callable[[float], tuple[float, float]]
Progress = Callable[[float], None]


def walk(
    control: RobotControl,
    controller: LocomotionController,
    clock: Clock,
    seconds: float,
    *,
    v_left: float = 1.0,
    v_right: float = 1.0,
    steer: Steering | None = None,
    cycle_s: float | None = None,
    progress: Progress | None = None,
) -> WalkReport:
    """Stand up, walk for ``seconds`` [s], and switch the torque off, whatever happens.

    ``control`` must have its joints in the order of ``controller``. ``steer``, if given, turns the
    time since the first step [s] into ``(v_left, v_right)``. ``cycle_s`` is the period of the
    control cycle [s]: by default the gait's, and 0 goes as fast as the bus allows. A cycle that
    takes longer is a missed deadline; nothing tries to catch up. ``progress`` is told the time
    walked [s] after each cycle. Goals beyond a joint's range are held at its bound and counted.

    Raises :class:`~hal.legs.UnreachableError` before the start for too long a stride,
    :class:`JointSilentError` before the start, :class:`~hal.bus_errors.BusError` if the bus fails,
    and :class:`WalkInterrupted` on Ctrl-C; the last two with the torque off.
    """
    if control.joints != controller.joints:
        raise ValueError("the joints of control and controller differ: make one from the other's")
    if steer is None:
        controller.check(v_left, v_right)
        constant = (v_left, v_right)

        def steer(_: float) -> tuple[float, float]:
            return constant

    run = _Run(control, controller, clock, progress)
    present_rad = first_positions(control)
    try:
        run.stand_up(present_rad)
        run.walk(seconds, steer, controller.gait.cycle_s if cycle_s is None else cycle_s)
    except BaseException as error:
        report = run.let_go()
        if report.torque_left_on:
            joints = ", ".join(report.torque_left_on)
            error.add_note(f"torque off was not confirmed by {joints}: cut the supply")
        if isinstance(error, KeyboardInterrupt):
            raise WalkInterrupted(report) from error
        raise
    return run.let_go()


def first_positions(control: RobotControl) -> Angles:
    """Read every joint before anything moves; joint angles [rad] in the order of ``joints``.

    A reply that is lost is asked for again, :data:`FIRST_READ_ATTEMPTS` times in all. Raises
    :class:`JointSilentError`.
    """
    positions_rad = control.read_positions()
    for _ in range(FIRST_READ_ATTEMPTS - 1):
        if not np.isnan(positions_rad).any():
            break
        again_rad = control.read_positions()
        positions_rad = np.where(np.isnan(positions_rad), again_rad, positions_rad)
    silent = [
        f"{joint} (servo {servo_id})"
        for joint, servo_id, position in zip(
            control.joints, control.ids, positions_rad, strict=True
        )
        if np.isnan(position)
    ]
    if silent:
        raise JointSilentError(
            f"no reply from {', '.join(silent)}: check power, wiring, IDs and baud rate; "
            "nothing was switched on"
        )
    return positions_rad


class _Run:
    """One walk under way."""

    def __init__(
        self,
        control: RobotControl,
        controller: LocomotionController,
        clock: Clock,
        progress: Progress | None,
    ) -> None:
        self._control = control
        self._controller = controller
        self._clock = clock
        self._progress = progress
        self._report = WalkReport()
        self._failures_before = Counter(control.client.statistics.failures)
        self._periods_s: list[float] = []
        self._silent_cycles = 0
        self._square_error = np.zeros(len(control.joints))
        self._samples = np.zeros(len(control.joints))

    def stand_up(self, present_rad: Angles) -> None:
        """Torque on where the joints are, then all of them slowly to the neutral posture."""
        control, clock = self._control, self._clock
        control.unlimit_speed()
        control.set_goals(present_rad)
        control.torque_on()
        start_s = clock.now_s()
        share = 0.0
        while share < 1.0:
            now_s = clock.now_s()
            share = min((now_s - start_s) / STAND_UP_S, 1.0)
            blend = share * share * (3.0 - 2.0 * share)
            self._exchange(present_rad + blend * (self._controller.neutral_rad - present_rad))
            clock.sleep_until(now_s + STAND_UP_CYCLE_S)

    def walk(self, seconds: float, steer: Steering, cycle_s: float) -> None:
        """Cycle until ``seconds`` have gone by."""
        clock, control, report = self._clock, self._control, self._report
        start_s = began_s = deadline_s = clock.now_s()
        advance_s = 0.0
        while began_s - start_s < seconds - END_TOLERANCE_S:
            v_left, v_right = steer(began_s - start_s)
            goals_rad = self._controller.advance(advance_s, v_left, v_right)
            held_rad = np.clip(goals_rad, control.lower_rad, control.upper_rad)
            report.clipped_goals += int(np.count_nonzero(held_rad != goals_rad))
            positions_rad = self._exchange(held_rad)
            self._track(held_rad - positions_rad)
            report.cycles += 1
            if cycle_s:
                deadline_s += cycle_s
                if clock.now_s() > deadline_s:
                    report.missed_deadlines += 1
                    deadline_s = clock.now_s()  # the next cycle starts late, at once
                clock.sleep_until(deadline_s)
            now_s = clock.now_s()
            self._periods_s.append(now_s - began_s)
            advance_s = min(now_s - began_s, LONGEST_ADVANCE_S)
            began_s = now_s
            report.walked_s = now_s - start_s
            if self._progress is not None:
                self._progress(report.walked_s)

    def let_go(self) -> WalkReport:
        """Torque off, even if a second Ctrl-C comes, and the report."""
        try:
            left_on = self._control.torque_off()
        except KeyboardInterrupt:
            left_on = self._control.torque_off()
        report = self._report
        report.torque_left_on = left_on
        report.alerts = self._control.alerts()
        failures = self._control.client.statistics.failures - self._failures_before
        report.errors = {kind.value: count for kind, count in failures.items()}
        if self._periods_s:
            report.cycle_mean_s = statistics.fmean(self._periods_s)
            report.cycle_median_s = statistics.median(self._periods_s)
            report.cycle_max_s = max(self._periods_s)
        rms_rad = np.sqrt(self._square_error / np.maximum(self._samples, 1.0))
        report.tracking_rms_rad = dict(zip(self._control.joints, rms_rad.tolist(), strict=True))
        return report

    def _exchange(self, goals_rad: Angles) -> Angles:
        """Goals out, positions in; a bus that has gone silent raises."""
        self._control.set_goals(goals_rad)
        positions_rad = self._control.read_positions()
        lost = int(np.count_nonzero(np.isnan(positions_rad)))
        self._report.lost_replies += lost
        self._silent_cycles = self._silent_cycles + 1 if lost == len(positions_rad) else 0
        if self._silent_cycles >= SILENT_CYCLES:
            raise BusSilentError(
                f"no servo has answered for {SILENT_CYCLES} cycles: check supply and wiring"
            )
        return positions_rad

    def _track(self, error_rad: Angles) -> None:
        there = ~np.isnan(error_rad)
        self._samples += there
        self._square_error += np.where(there, error_rad, 0.0) ** 2
