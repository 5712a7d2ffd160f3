"""When a servo protects itself: voltage, temperature, overload.

What is watched is the plant's state; what follows is coded by the model's ``shutdown`` register.
"""

from __future__ import annotations

from collections.abc import Mapping

from ..plant import ServoState
from ..tables import ControlTable
from .memory import Memory
from .status import ALARM_BITS_V1, ALARM_NAMES, Alarm

#: A joint slower than this under full duty is stalled, not slewing [rad/s]. Assumed.
STALL_VELOCITY_RAD_S = 0.2


#: Alarms that do not end with their cause.
HELD = Alarm.OVERLOAD | Alarm.ENCODER | Alarm.ELECTRICAL_SHOCK


class Protection:
    """Watches one servo and says which alarms it holds.

    Voltage and temperature alarms last as long as their cause. Overload needs a stalled joint at
    the drive's full duty for the model's ``overload_s``, and is held until :meth:`clear`; encoder
    and electrical shock come from outside (:meth:`raise_alarm`) and are held. Where the model
    latches, so is every alarm that shuts the servo down. A reboot makes a new one of these.
    """

    def __init__(self, table: ControlTable) -> None:
        self.alarms = Alarm.NONE
        self._share = float(table.drive.get("overload_torque", 1.0))
        self._allowed_s = float(table.drive.get("overload_s", 1.0))
        self._stalled_since_s: float | None = None
        self._latches = bool(table.drive.get("shutdown_latches", False))
        self._bits = _bits(table)

    def watch(self, state: ServoState, memory: Memory, now_s: float) -> bool:
        """Update the alarms; true when the servo must shut down because of one it now holds."""
        if self.alarms:
            self.alarms &= HELD | self._shutting_down(memory)
        self._watch_causes(state, memory)
        stalled = (
            abs(state.duty) >= self._share and abs(state.velocity_rad_s) < STALL_VELOCITY_RAD_S
        )
        if not stalled:
            self._stalled_since_s = None
        elif self._stalled_since_s is None:
            self._stalled_since_s = now_s
        elif now_s - self._stalled_since_s >= self._allowed_s:
            self.alarms |= Alarm.OVERLOAD
        coded = self.coded()
        return coded != 0 and bool(coded & memory["shutdown"])

    def _watch_causes(self, state: ServoState, memory: Memory) -> None:
        """Note the alarms that last as long as their cause does."""
        low, high = memory.si("min_voltage_limit"), memory.si("max_voltage_limit")
        if not low <= round(state.voltage_v, 1) <= high:
            self.alarms |= Alarm.VOLTAGE
        if state.temperature_c > memory.si("temperature_limit"):
            self.alarms |= Alarm.OVERHEATING

    def coded(self) -> int:
        """The alarms as bits of the model's ``shutdown`` register."""
        if not self.alarms:
            return 0
        return sum(bit for alarm, bit in self._bits.items() if alarm in self.alarms)

    def raise_alarm(self, alarm: Alarm) -> None:
        """Have an alarm whose cause is not in the plant's state: encoder, electrical shock."""
        self.alarms |= alarm

    def knows(self, alarm: Alarm) -> bool:
        """Whether the model has a bit for an alarm."""
        return alarm in self._bits

    def _shutting_down(self, memory: Memory) -> Alarm:
        """The alarms that stay because they shut the servo down."""
        found = Alarm.NONE
        if self._latches:
            for alarm, bit in self._bits.items():
                if bit & memory["shutdown"]:
                    found |= alarm
        return found

    def clear_all(self, state: ServoState, memory: Memory) -> None:
        """Forget every alarm whose cause is over, as an error clear asks for."""
        self.alarms = Alarm.NONE
        self._stalled_since_s = None
        self._watch_causes(state, memory)

    def clear(self) -> None:
        """Forget a held overload."""
        self.alarms &= ~Alarm.OVERLOAD
        self._stalled_since_s = None


def _bits(table: ControlTable) -> Mapping[Alarm, int]:
    """Bits of the ``shutdown`` register: the table's, or else those of the error byte."""
    named = table.drive.get("shutdown_bits")
    if named is None:
        return ALARM_BITS_V1
    return {ALARM_NAMES[name]: 1 << bit for name, bit in named.items()}
