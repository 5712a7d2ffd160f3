"""What a write has to pass before any byte of it is stored."""

from __future__ import annotations

from .indirect import Indirect, Run
from .memory import Memory
from .registers import Behaviour
from .status import Refusal


class Writing:
    """The writes of one servo: where their bytes go, and what is against them."""

    def __init__(self, memory: Memory, indirect: Indirect, behaviour: Behaviour) -> None:
        self._memory = memory
        self._indirect = indirect
        self._behaviour = behaviour
        self._lock = str(memory.table.drive["eeprom_locked_by"])

    def runs(self, address: int, data: bytes) -> list[Run]:
        """Where the bytes of a write go; they go nowhere else if the addresses do not exist."""
        if not self._memory.covers(address, len(data)):
            return [(address, data)]
        return self._indirect.runs(address, data)

    def check(self, runs: list[Run], *, shut_down: bool) -> Refusal | None:
        """Why a write is refused, if it is; ``shut_down``: an alarm holds until a reboot."""
        memory, lock = self._memory, self._lock
        for address, data in runs:
            refusal = memory.check(address, data)
            if refusal is not None:
                return refusal
            for register in memory.registers(address, len(data)):
                if memory[lock] and (register.area == "EEPROM" or register.name == lock == "lock"):
                    return Refusal.ACCESS
                after = memory.after(register, address, data)
                refusal = self._behaviour.refuse(register, after)
                if refusal is not None:
                    return refusal
                if register.name == "torque_enable" and after and shut_down:
                    return Refusal.RESULT
        return None
