"""What a servo shows: the angle its sensor makes of the shaft, and a load that it seldom renews."""

from __future__ import annotations

import math

import numpy as np

from .drive import fields, firmware
from .drive.fields import Array
from .tree import PhysicalRobot

ON_TIME = 1e-6  #: share of a period by which a step may seem to end before it


class ShownPosition:
    """Where the angle that is shown is not the output shaft's at this instant.

    ``zero_offset`` and ``encoder_nonlinearity`` turn the angle, ``read_skew`` shows one of another
    instant. A later one is not known yet: then the shaft is taken to go on at its speed.
    """

    def __init__(self, robot: PhysicalRobot, params: Array, step_s: float) -> None:
        self._params = params
        turned = (params[fields.ZERO_OFFSET] != 0.0) | (params[fields.WAVE] != 0.0)
        self._turned: list[bool] = turned.tolist()
        self._skew_s = robot.reading.skew_s
        self._step_s = step_s
        self._kept: list[Array] = []  #: the shafts' angles at the ends of the last steps, a ring
        if self._skew_s < 0.0:
            count = math.ceil(-self._skew_s / step_s) + 2
            self._kept = [np.zeros(len(self._turned)) for _ in range(count)]

    @staticmethod
    def needed(robot: PhysicalRobot, params: Array) -> bool:
        """Whether any servo of the robot shows another angle than its shaft's."""
        turned = params[fields.ZERO_OFFSET].any() or params[fields.WAVE].any()
        return bool(turned) or robot.reading.skew_s != 0.0

    def keep(self, steps: int, position_rad: Array) -> None:
        """Note the shafts' angles (servo frame) at the end of so many steps."""
        if self._kept:
            self._kept[steps % len(self._kept)][:] = position_rad

    def __call__(self, i: int, now_s: float, position_rad: float, velocity_rad_s: float) -> float:
        """What servo ``i`` shows [rad], its shaft at ``position_rad`` now."""
        if self._kept:
            place = max(0.0, (now_s + self._skew_s) / self._step_s)
            before = math.floor(place)
            low, high = (float(self._kept[k % len(self._kept)][i]) for k in (before, before + 1))
            position_rad = low + (place - before) * (high - low)
        else:
            position_rad += self._skew_s * velocity_rad_s
        if self._turned[i]:
            position_rad = firmware.sense(self._params, i, position_rad)
        return position_rad


class ShownDuty:
    """The duty that a load register shows, renewed at the multiples of a period (``load_refresh``).

    All servos are renewed together; before the first time they show none.
    """

    def __init__(self, period_s: float, servos: int) -> None:
        self._period_s = period_s
        self._times = 0
        self._duty = np.zeros(servos)

    def keep(self, end_s: float, duty: Array) -> None:
        """Note the duties during a step that ended at ``end_s`` [s since the start]."""
        times = math.floor(end_s / self._period_s + ON_TIME)
        if times > self._times:
            self._times = times
            self._duty[:] = duty

    def __call__(self, i: int) -> float:
        """What servo ``i`` shows."""
        return float(self._duty[i])
