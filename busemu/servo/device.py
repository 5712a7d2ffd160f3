"""One servo on the bus: an instruction comes in, registers change, a status packet may go out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

from ..plant import Plant
from ..protocol import BROADCAST_ID, Instruction, StatusPacket
from ..tables import ControlTable, ServoMount
from .backup import RESTORE, Backup
from .indirect import Indirect, Run
from .memory import Memory, baud_rate_code
from .reading import Reading
from .registers import behaviour
from .shutdown import Protection
from .status import Refusal, error_byte
from .writing import Writing

#: Time from a reboot until the servo listens again [s]. Assumed.
REBOOT_S = 0.2

#: Instructions that a servo takes when it alone is addressed, if its model has them.
SINGLE = frozenset(
    {
        Instruction.PING,
        Instruction.READ,
        Instruction.WRITE,
        Instruction.REG_WRITE,
        Instruction.ACTION,
        Instruction.FACTORY_RESET,
        Instruction.REBOOT,
        Instruction.CLEAR,
        Instruction.CONTROL_TABLE_BACKUP,
    }
)
#: Instructions that bring data, which status return level 1 answers. Level 0 answers ping only.
READING = frozenset(
    {Instruction.PING, Instruction.READ, Instruction.SYNC_READ, Instruction.BULK_READ}
)
#: What a clear instruction names to have the turns forgotten, and errors. Source: e-manual,
#: protocol2; the second is for the models whose table says ``drive.clears_errors``.
CLEAR_TURNS, CLEAR_ERRORS = b"\x01DXL\x22", b"\x02ERCL"
_FACTORY_RESET_KEEPS = MappingProxyType(
    {0xFF: frozenset[str](), 0x01: frozenset({"id"}), 0x02: frozenset({"id", "baud_rate"})}
)


class Servo:
    """A servo of one model, wired to one joint of a plant.

    Time enters as ``now_s`` [s, the bus's clock]; the plant must have been advanced to it. While it
    writes its EEPROM, ``eeprom_byte_s`` [s] a byte, it does not listen; ``on_eeprom`` is called
    whenever it has written there.
    """

    def __init__(
        self,
        mount: ServoMount,
        table: ControlTable,
        plant: Plant,
        baud_rate: int,
        *,
        eeprom_byte_s: float = 0.0,
    ) -> None:
        self.on_eeprom: Callable[[], object] | None = None
        self._eeprom_byte_s = eeprom_byte_s
        self.joint = mount.joint
        self.table = table
        self.memory = Memory(table, mount.registers.get("firmware_version"))
        self.protection = Protection(table)
        self._plant = plant
        self._plant_id = mount.servo_id
        self._registered: tuple[int, bytes] | None = None
        self._deaf_until_s = 0.0
        self._now_s: float | None = None  #: the latest instant it was told of
        self._heard_s = 0.0  #: when it last had an instruction
        self._indirect = Indirect(self.memory)
        self.backup = Backup(self.memory)
        self._behaviour = behaviour(self.memory)
        self._reading = Reading(self.memory, self._indirect, self._behaviour)
        self._writing = Writing(self.memory, self._indirect, self._behaviour)
        firmware = self.memory["firmware_version"]
        self._instructions = frozenset(
            instruction
            for instruction in Instruction
            if table.supports(instruction.name.lower(), firmware)
        )
        self.memory["id"] = mount.servo_id
        self.memory["baud_rate"] = baud_rate_code(table, baud_rate)
        for name, raw in mount.registers.items():
            self.memory[name] = raw
        self._power_on()

    def _power_on(self) -> None:
        """What a servo does when it gets power: RAM from the table, goal where it stands."""
        memory = self.memory
        memory.reset(r for r in self.table.registers if r.area == "RAM")
        self.protection = Protection(self.table)
        self._registered = None
        self.backup.start_up()
        self._behaviour.power_on(self._plant.sample(self._plant_id), self._now_s or 0.0)
        self._hear()
        self._command()

    def recall(self, registers: Mapping[str, int], backup: Mapping[str, int]) -> None:
        """Get power with an EEPROM, raw values by name, and a backup that lasted from before."""
        for name, raw in registers.items():
            self.memory[name] = raw
        self.backup.values = MappingProxyType(dict(backup))
        self._power_on()

    def learn(self, name: str, raw: int) -> None:
        """Have a register be as another servo of the model has it."""
        self.memory[name] = raw
        self._hear()
        self._command()

    def _command(self) -> None:
        self._plant.command(self._plant_id, self._behaviour.command())

    def _note(self, now_s: float) -> None:
        """Take the bus's time; the first time it is told, the servo has just got power."""
        if self._now_s is None:
            self._now_s = self._heard_s = now_s
            self._behaviour.power_on(self._plant.sample(self._plant_id), now_s)
        self._now_s = max(self._now_s, now_s)

    def _hear(self) -> None:
        """Note what every packet asks of the registers: ID, baud rate [bit/s], what is answered."""
        code = self.memory["baud_rate"]
        self.servo_id = self.memory["id"]
        self._status_return_level = self.memory["status_return_level"]
        self.baud_rate = self.table.baud_rates.get(code) or round(2_000_000 / (code + 1))

    @property
    def return_delay_s(self) -> float:
        """Its return delay time [s]."""
        return self.memory.si("return_delay_time")

    def listens(self, now_s: float) -> bool:
        """Whether it takes packets in: not so while it reboots or writes its EEPROM.

        The bus asks before it hands over anything; so :meth:`read` and :meth:`write` know the time.
        """
        self._note(now_s)
        return now_s >= self._deaf_until_s

    def supports(self, instruction: int) -> bool:
        """Whether its model, at its firmware, has an instruction."""
        return instruction in self._instructions

    def answers(self, instruction: int) -> bool:
        """Whether its status return level has it answer an instruction to it alone."""
        if instruction == Instruction.PING:
            return True
        return self._status_return_level >= (1 if instruction in READING else 2)

    def status(self, refusal: Refusal | None = None, parameters: bytes = b"") -> StatusPacket:
        """A status packet of this servo as it is now."""
        return StatusPacket(self.servo_id, self.error(refusal), parameters)

    def error(self, refusal: Refusal | None) -> int:
        """The error byte of a status packet of this servo as it is now."""
        if refusal is None and not self.protection.alarms:
            return 0
        return error_byte(self.table.protocol, refusal, self.protection.alarms)

    # -- instructions ------------------------------------------------------------------------

    def execute(
        self, servo_id: int, instruction: int, parameters: bytes, now_s: float
    ) -> StatusPacket | None:
        """Carry out an instruction to ``servo_id`` (its own ID, or the broadcast ID).

        Returns the status packet, or ``None`` where the servo stays silent.
        """
        self._note(now_s)
        self._heard_s = now_s
        silent = servo_id == BROADCAST_ID or not self.answers(instruction)
        own_id = self.servo_id
        everyone = servo_id == BROADCAST_ID
        refusal, data = self._carry_out(instruction, parameters, everyone=everyone)
        error = self.error(refusal)
        if refusal is None and self._ends_in_reboot(instruction, parameters):
            self._reboot(now_s)
        return None if silent else StatusPacket(own_id, error, data if refusal is None else b"")

    def _carry_out(
        self, instruction: int, parameters: bytes, *, everyone: bool
    ) -> tuple[Refusal | None, bytes]:
        """Do what an instruction says; why not, and the data that the status packet brings."""
        if instruction not in SINGLE or not self.supports(instruction):
            return Refusal.INSTRUCTION, b""
        refusal, data = None, b""
        if instruction == Instruction.PING:
            data = self.identity()
        elif instruction == Instruction.ACTION:
            refusal = self._action()
        elif instruction == Instruction.FACTORY_RESET:
            refusal = self._factory_reset(parameters, everyone=everyone)
        elif instruction == Instruction.CLEAR:
            refusal = self._clear(parameters)
        elif instruction == Instruction.CONTROL_TABLE_BACKUP:
            refusal = self.backup.carry_out(parameters)
            if refusal is None:
                self._eeprom_written(self.backup.size)
        elif instruction != Instruction.REBOOT:
            refusal, data = self._access(instruction, parameters)
        return refusal, data

    def _access(self, instruction: int, parameters: bytes) -> tuple[Refusal | None, bytes]:
        """Read, write and reg_write: an address, and then a length or the data."""
        width = 2 if self.table.protocol == 2.0 else 1
        address, rest = int.from_bytes(parameters[:width], "little"), parameters[width:]
        if instruction == Instruction.READ:
            if len(rest) != width:
                return Refusal.LENGTH, b""
            return self.read(address, int.from_bytes(rest, "little"))
        if not rest:
            return Refusal.LENGTH, b""
        write = self.write if instruction == Instruction.WRITE else self._register
        return write(address, rest), b""

    def identity(self) -> bytes:
        """What a ping brings: nothing in 1.0, model number and firmware version in 2.0."""
        if self.table.protocol == 1.0:
            return b""
        number = self.memory["model_number"].to_bytes(2, "little")
        return number + bytes([self.memory["firmware_version"]])

    def read(self, address: int, length: int) -> tuple[Refusal | None, bytes]:
        """Read registers as they are at this instant."""
        show = self._reading.view(address, length)
        if show is None:
            return Refusal.ACCESS, b""
        self._heard_s = now_s = self._now_s or 0.0
        show(self._plant.sample(self._plant_id), now_s)
        return None, self._indirect.read(address, length)

    def write(self, address: int, data: bytes) -> Refusal | None:
        """Write registers; a refused write changes nothing."""
        self._heard_s = self._now_s or 0.0
        runs = self._writing.runs(address, data)
        refusal = self._writing.check(runs, shut_down=self._is_shut_down())
        if refusal is None:
            self._store(runs)
        return refusal

    def _is_shut_down(self) -> bool:
        """Whether an alarm shutdown holds until a reboot (models that cut ``torque_enable``)."""
        coded = self.protection.coded()
        cut = coded and self.table.drive["shutdown_cuts"] == "torque_enable"
        return bool(cut and coded & self.memory["shutdown"])

    def _store(self, runs: list[Run]) -> None:
        memory = self.memory
        touched = set[str]()
        for address, data in runs:
            memory.store(address, data)
            touched |= {register.name for register in memory.registers(address, len(data))}
        if "torque_limit" in touched and memory["torque_limit"]:
            self.protection.clear()
        if touched & self._behaviour.reacts:
            state = self._plant.sample(self._plant_id)
            self._behaviour.written(touched, state, self._now_s or 0.0)
        if self._is_shut_down():
            memory["torque_enable"] = 0
        self._hear()
        self._command()
        in_eeprom = self.memory.eeprom_bytes(runs)
        if in_eeprom:
            self._eeprom_written(in_eeprom)

    def _eeprom_written(self, count: int) -> None:
        """Be deaf for as long as so many bytes take; the next instruction finds them there."""
        self._deaf_until_s = max(
            self._deaf_until_s, (self._now_s or 0.0) + count * self._eeprom_byte_s
        )
        if self.on_eeprom is not None:
            self.on_eeprom()

    def _register(self, address: int, data: bytes) -> Refusal | None:
        runs = self._writing.runs(address, data)
        refusal = self._writing.check(runs, shut_down=self._is_shut_down())
        if refusal is None:
            self._registered = (address, data)
            self._show_registered()
        return refusal

    def _action(self) -> Refusal | None:
        if self._registered is None:
            return Refusal.INSTRUCTION
        address, data = self._registered
        self._registered = None
        self._show_registered()
        return self.write(address, data)

    def _show_registered(self) -> None:
        if self.memory.has("registered_instruction"):
            self.memory["registered_instruction"] = int(self._registered is not None)

    def _factory_reset(self, parameters: bytes, *, everyone: bool) -> Refusal | None:
        keeps = frozenset[str]()
        if self.table.protocol == 2.0:
            if len(parameters) != 1:
                return Refusal.LENGTH
            if parameters[0] not in _FACTORY_RESET_KEEPS:
                return Refusal.RANGE
            if everyone and parameters[0] == 0xFF:
                return Refusal.RESULT
            keeps = _FACTORY_RESET_KEEPS[parameters[0]]
        elif parameters:
            return Refusal.LENGTH
        renewed = [r for r in self.table.registers if r.writable and r.name not in keeps]
        self.memory.reset(renewed)
        self._power_on()
        self._eeprom_written(sum(r.size for r in renewed if r.area == "EEPROM"))
        return None

    def _clear(self, parameters: bytes) -> Refusal | None:
        """Forget the turns, at standstill only; forget errors, where the model does that.

        Anything else is reserved (e-manual); which error answers it is assumed.
        """
        if len(parameters) != len(CLEAR_TURNS):
            return Refusal.LENGTH
        if parameters == CLEAR_TURNS:
            if self._shown("moving"):
                return Refusal.RESULT
            self._behaviour.forget_turns(self._plant.sample(self._plant_id), self._now_s or 0.0)
            self._command()
            return None
        if parameters != CLEAR_ERRORS or not self.table.drive.get("clears_errors"):
            return Refusal.RANGE
        self.protection.clear_all(self._plant.sample(self._plant_id), self.memory)
        return Refusal.RESULT if self.protection.alarms else None

    def _shown(self, name: str) -> int:
        """A register as a read would bring it now."""
        self._behaviour.show(self._plant.sample(self._plant_id), self._now_s or 0.0)
        return self.memory[name]

    def _ends_in_reboot(self, instruction: int, parameters: bytes) -> bool:
        """Whether the servo reboots once it has answered."""
        restores = instruction == Instruction.CONTROL_TABLE_BACKUP and parameters[0] == RESTORE
        return restores or instruction == Instruction.REBOOT

    def _reboot(self, now_s: float) -> None:
        self._power_on()
        self._deaf_until_s = max(self._deaf_until_s, now_s + REBOOT_S)

    # -- what befalls it -----------------------------------------------------------------------

    @property
    def plant(self) -> Plant:
        """What moves its joint and measures it."""
        return self._plant

    @plant.setter
    def plant(self, plant: Plant) -> None:
        self._plant = plant
        self._command()

    def lose_power(self, now_s: float) -> None:
        """Be limp and deaf from ``now_s`` [s] until :meth:`regain_power`; the RAM area is lost."""
        self._note(now_s)
        self._power_on()
        self._deaf_until_s = math.inf

    def regain_power(self, now_s: float) -> None:
        """Start up at ``now_s`` [s]."""
        self._note(now_s)
        self._power_on()
        self._deaf_until_s = now_s + REBOOT_S

    def take_id(self, servo_id: int) -> None:
        """Have another ID, as if somebody had set it wrongly."""
        self.memory["id"] = servo_id
        self._hear()

    # -- what goes on without any instruction --------------------------------------------------

    def tick(self, now_s: float) -> None:
        """Housekeeping, every few milliseconds: protection, watchdog, slow registers."""
        self._note(now_s)
        state = self._plant.sample(self._plant_id)
        changed = self._behaviour.idle(state, now_s, now_s - self._heard_s)
        if self.protection.watch(state, self.memory, now_s):
            cut = str(self.table.drive["shutdown_cuts"])
            if self.memory[cut]:
                self.memory[cut] = 0
                changed = True
        if changed:
            self._command()
        if self.memory.has("hardware_error_status"):
            self.memory["hardware_error_status"] = self.protection.coded()
