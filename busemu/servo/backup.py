"""Control table backup: what a servo puts aside on request, and brings back.

Source: e-manual, protocol2, "Control Table Backup", and the X series' "Startup Configuration". Put
aside are the EEPROM area and, of the RAM area, the gains, the profile and the indirect addresses. A
restore brings back the EEPROM area, and the servo then reboots; the rest comes back at a start with
bit 1 of ``startup_configuration`` set.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ..tables import Register
from .memory import Memory
from .status import Refusal

#: What must follow the option of a backup instruction: "CTRL". Source: e-manual.
KEY = b"CTRL"
STORE, RESTORE = 0x01, 0x02
#: Bits of ``startup_configuration``. Source: e-manual.
STARTUP_TORQUE_ON, RAM_RESTORE = 0x01, 0x02
#: The RAM that is put aside, besides the indirect addresses. Source: e-manual.
RAM = frozenset(
    {
        "velocity_i_gain",
        "velocity_p_gain",
        "position_d_gain",
        "position_i_gain",
        "position_p_gain",
        "feedforward_2nd_gain",
        "feedforward_1st_gain",
        "profile_acceleration",
        "profile_velocity",
    }
)


class Backup:
    """The backup area of one servo: register names to raw values, empty until something is stored.

    Neither a reboot nor a factory reset empties it (the latter assumed).
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self.values: Mapping[str, int] = MappingProxyType({})

    @property
    def names(self) -> frozenset[str]:
        """The registers that a backup holds."""
        return frozenset(r.name for area in ("EEPROM", "RAM") for r in self._kept(area))

    @property
    def size(self) -> int:
        """Bytes of what is stored."""
        return sum(self._memory.table[name].size for name in self.values)

    def _kept(self, area: str) -> list[Register]:
        return [
            register
            for register in self._memory.writable(area)
            if area == "EEPROM"
            or register.name in RAM
            or register.name.startswith("indirect_address_")
        ]

    def _store(self) -> None:
        """Put the present values aside."""
        kept = [*self._kept("EEPROM"), *self._kept("RAM")]
        self.values = MappingProxyType({r.name: self._memory[r.name] for r in kept})
        self._show()

    def _restore(self, area: str) -> None:
        """Bring back the values of one area, as far as they were stored."""
        for register in self._kept(area):
            if register.name in self.values:
                self._memory[register.name] = self.values[register.name]

    def carry_out(self, parameters: bytes) -> Refusal | None:
        """Put the control table aside or bring its EEPROM area back; only with torque off.

        Source: e-manual. Nothing to bring back is a failure, another option out of range (both
        assumed).
        """
        if len(parameters) != 1 + len(KEY):
            return Refusal.LENGTH
        if parameters[1:] != KEY or parameters[0] not in (STORE, RESTORE):
            return Refusal.RANGE
        if self._memory["torque_enable"]:
            return Refusal.RESULT
        if parameters[0] == STORE:
            self._store()
        elif self.values:
            self._restore("EEPROM")
        else:
            return Refusal.RESULT
        return None

    def start_up(self) -> None:
        """What a servo does with its backup at power-on, as ``startup_configuration`` asks."""
        memory = self._memory
        self._show()
        if memory.has("startup_configuration"):
            if memory["startup_configuration"] & RAM_RESTORE:
                self._restore("RAM")
            memory["torque_enable"] = memory["startup_configuration"] & STARTUP_TORQUE_ON

    def _show(self) -> None:
        """Say in ``backup_ready`` whether there is anything."""
        if self._memory.has("backup_ready"):
            self._memory["backup_ready"] = int(bool(self.values))
