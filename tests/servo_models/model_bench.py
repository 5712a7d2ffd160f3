"""One servo with a joint whose state the test writes, and its registers by name."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from busemu.plant import DriveCommand, ServoState
from busemu.protocol import Instruction
from busemu.servo import Refusal, Servo
from busemu.tables import ServoMount, load_table

COUNT_RAD = 2.0 * math.pi / 4096
#: rad/s a count of velocity. Source: e-manual, 0.229 rev/min.
VELOCITY = 0.229 * math.pi / 30.0
AT_REST = ServoState(0.0, 0.0, 0.0, 0.0, 0.0, 12.0, 25.0)


@dataclass
class Joint:
    """A plant of one joint, which stays as it is put."""

    state: ServoState = AT_REST
    last: DriveCommand = field(default_factory=DriveCommand)

    def advance(self, to_s: float) -> None:
        """Nothing moves."""

    def command(self, servo_id: int, command: DriveCommand) -> None:
        self.last = command

    def sample(self, servo_id: int) -> ServoState:
        return self.state

    def observe(self) -> dict[str, float]:
        return {}


class OneServo:
    """A servo that is spoken to as the bus does: each access notes the time first."""

    def __init__(self, model: str, *, at_count: int | None = None, **registers: int) -> None:
        self.joint = Joint()
        self.table = load_table(model)
        self.now_s = 0.0
        voltage = self.table["max_voltage_limit"].initial
        assert voltage is not None
        self.joint.state = replace(AT_REST, voltage_v=voltage / 10.0)
        if at_count is not None:
            self.stand(at_count)
        mount = ServoMount(1, model, "j", registers=registers)
        baud_rate = 1_000_000
        self.servo = Servo(mount, self.table, self.joint, baud_rate)
        self.servo.tick(0.0)

    @property
    def command(self) -> DriveCommand:
        return self.joint.last

    @property
    def goal_count(self) -> float:
        """Where the drive is told to go, in counts of the shaft, turns and all."""
        return self.command.goal_position_rad / COUNT_RAD + 2048

    def stand(self, count: float) -> None:
        """Turn the shaft to so many counts, turns and all."""
        self.state(position_rad=(count - 2048) * COUNT_RAD)

    def state(self, **changes: float) -> None:
        self.joint.state = replace(self.joint.state, **changes)

    def sleep(self, seconds: float, *, tick_s: float = 0.010) -> None:
        """Let time pass with nothing said."""
        for _ in range(round(seconds / tick_s)):
            self.now_s += tick_s
            self.servo.tick(self.now_s)

    def get(self, name: str) -> int:
        """A register's decoded count, read as the bus reads it."""
        register = self.table[name]
        assert self.servo.listens(self.now_s)
        refusal, data = self.servo.read(register.address, register.size)
        assert refusal is None
        return register.decode(int.from_bytes(data, "little"))

    def write(self, name: str, count: int) -> Refusal | None:
        register = self.table[name]
        raw = count & register.raw_maximum if register.encoding == "signed" else count
        if register.encoding == "sign_magnitude":
            raw = register.encode(count)
        return self.write_bytes(register.address, raw.to_bytes(register.size, "little"))

    def write_bytes(self, address: int, data: bytes) -> Refusal | None:
        assert self.servo.listens(self.now_s)
        return self.servo.write(address, data)

    def set(self, **registers: int) -> None:
        """Writes that succeed, in order."""
        for name, count in registers.items():
            assert self.write(name, count) is None, name

    def instruct(self, instruction: Instruction, parameters: bytes = b"") -> Any:
        return self.servo.execute(1, instruction, parameters, self.now_s)

    def reboot(self) -> None:
        self.instruct(Instruction.REBOOT)
        self.now_s += 1.0
        self.servo.tick(self.now_s)


def robot_file(folder: Path, text: str) -> Path:
    path = folder / "robot.toml"
    path.write_text(text, "utf-8")
    return path
