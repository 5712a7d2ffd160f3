"""The shadow of a real bus: what it says, and what it keeps quiet about."""

from __future__ import annotations

import math
import os
import re
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from dynamixel_sdk import GroupSyncRead, PacketHandler, PortHandler

from bench.shadow import HOLD_S, SETTLE_S, Parting, Shadow, ShadowError, parse_thresholds
from bench.wire_decoder import WireDecoder
from busemu.assemble import assemble
from busemu.plant import IdealPlant, ServoState, ideal
from busemu.protocol import Instruction, InstructionPacket, v1, v2
from busemu.tables import Robot, load_robot
from busemu.timing import load_profile

#: The longest any wait below may last [s]; it ends a test that fails, none that passes.
PATIENCE_S = 20.0
MARVIN = load_robot("marvin")
TABLE = MARVIN.tables[1]


class Stuck(IdealPlant):
    """Joints of which one does not move, from an instant on."""

    def __init__(self, robot: Robot, servo_id: int, from_s: float = 0.0) -> None:
        super().__init__([mount.servo_id for mount in robot.servos], voltage_v=7.4)
        self.stuck, self.from_s, self.at_s = servo_id, from_s, 0.0
        self.held_rad = 0.0

    def advance(self, to_s: float) -> None:
        super().advance(to_s)
        self.at_s = to_s

    def sample(self, servo_id: int) -> ServoState:
        state = super().sample(servo_id)
        if servo_id != self.stuck or self.at_s < self.from_s:
            return state
        return ServoState(self.held_rad, 0.0, 0.0, 0.0, 0.0, 7.4, 25.0)


class Beside:
    """A program at a real bus, which here is emulated as well, with a shadow beside it."""

    def __init__(self, real: IdealPlant | None = None, **thresholds: float) -> None:
        self.told: list[Parting] = []
        instant = load_profile("instant")
        self.real = assemble(MARVIN, real or ideal(MARVIN), instant, start_s=5.0)
        self.shadow = Shadow(MARVIN, ideal(MARVIN), 5.0, self.told.append, thresholds)
        self.decoder = WireDecoder(MARVIN.protocol, MARVIN.tables, self.shadow.seen)
        self.now_s = 5.0
        self.silent: set[int] = set()

    def send(self, instruction: int, parameters: bytes, servo_id: int = 0xFE, cut: int = 0) -> None:
        data = v2.encode_instruction(InstructionPacket(servo_id, instruction, parameters))
        for part in (data[:cut], data[cut:]):
            if part:
                self.now_s += 0.01
                self.shadow.sent(part, self.now_s, 1_000_000)
                self.decoder.sent(part, self.now_s)
        self.real.poll(self.now_s)
        self.real.receive(data, self.now_s)
        answer = self.real.poll(self.now_s)
        if answer and servo_id not in self.silent:
            self.decoder.received(answer, self.now_s)

    def write(self, name: str, raw: int, servo_id: int = 0xFE) -> None:
        register = TABLE[name]
        address = register.address.to_bytes(2, "little")
        data = address + raw.to_bytes(register.size, "little")
        self.send(Instruction.WRITE, data, servo_id)

    def read(self, name: str, servo_id: int) -> None:
        register = TABLE[name]
        data = register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little")
        self.send(Instruction.READ, data, servo_id)

    def read_all(self, name: str, seconds: float, cut: int = 0) -> None:
        register = TABLE[name]
        data = register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little")
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.send(Instruction.SYNC_READ, data + bytes(range(1, 19)), cut=cut)

    def go(self, raw: int = 700) -> None:
        self.write("torque_enable", 1)
        self.write("goal_position", raw)


def test_two_alike_never_part() -> None:
    beside = Beside()
    beside.go()
    beside.read_all("present_position", 4.0)
    beside.read_all("present_voltage", 0.5)
    assert beside.told == []
    assert beside.shadow.pairs[3, "present_position"].compared > 100
    (line,) = beside.shadow.summary(5.0)
    assert line.endswith("0 registers parted")


def test_a_joint_that_stands_still_is_named_with_what_was_expected_and_seen() -> None:
    beside = Beside(Stuck(MARVIN, 3))
    beside.go()
    goal_rad = TABLE["goal_position"].to_si(700)
    told_s = beside.now_s
    beside.read_all("present_position", 4.0)
    (parting,) = beside.told
    assert (parting.servo_id, parting.register, parting.unit) == (3, "present_position", "rad")
    assert parting.expected == pytest.approx(goal_rad, abs=0.01)
    assert parting.seen == pytest.approx(0.0, abs=0.01)
    assert told_s + SETTLE_S <= parting.since_s < told_s + SETTLE_S + 0.05
    assert HOLD_S <= parting.t_s - parting.since_s < HOLD_S + 0.05
    assert "servo 3 present_position: expected" in parting.words(5.0)
    first, second = beside.shadow.summary(5.0)
    assert first.endswith("1 register parted")
    assert "servo 3 present_position" in second
    assert "still apart" in second


def test_they_are_together_again_once_the_readings_agree() -> None:
    beside = Beside(plant := Stuck(MARVIN, 3))
    beside.go()
    beside.read_all("present_position", 3.0)
    plant.stuck = 0
    beside.read_all("present_position", 1.0)
    assert [parting.over for parting in beside.told] == [False, True]
    assert "together again" in beside.told[1].words(5.0)
    assert "still apart" not in beside.shadow.summary(5.0)[1]


def test_a_glitch_is_no_parting() -> None:
    beside = Beside(plant := Stuck(MARVIN, 0))
    beside.go()
    beside.read_all("present_position", 3.0)
    plant.stuck = 3
    beside.read_all("present_position", HOLD_S / 2)
    plant.stuck = 0
    beside.read_all("present_position", 1.0)
    assert beside.told == []
    assert beside.shadow.pairs[3, "present_position"].beyond > 0


def test_where_a_joint_stands_says_nothing_before_it_was_told_where_to_go() -> None:
    plant = Stuck(MARVIN, 3)
    plant.held_rad = 1.0
    beside = Beside(plant)
    beside.read_all("present_position", 3.0)
    beside.write("torque_enable", 1)
    beside.read_all("present_position", 3.0)
    assert beside.told == []


def test_a_servo_that_falls_silent_is_named() -> None:
    beside = Beside()
    beside.read("present_voltage", 4)
    beside.silent = {4}
    for _ in range(40):
        beside.read("present_voltage", 4)
        beside.read("present_voltage", 5)
    (parting,) = beside.told
    assert (parting.servo_id, parting.register) == (4, "present_voltage")
    assert math.isnan(parting.seen)
    assert "seen silence" in parting.words(5.0)


def test_settings_are_learned_until_the_program_writes_them() -> None:
    beside = Beside()
    (servo,) = [servo for servo in beside.real.servos if servo.servo_id == 2]
    servo.learn("p_gain", 99)
    beside.read("p_gain", 2)
    beside.read("p_gain", 2)  # the shadow is told of a read by the next one at the latest
    assert beside.shadow._servos[2].memory["p_gain"] == 99
    assert beside.told == []
    beside.write("p_gain", 40, 2)
    servo.learn("p_gain", 41)
    for _ in range(20):
        beside.read("p_gain", 2)
    assert [(p.expected, p.seen) for p in beside.told] == [(40, 41)]


def test_thresholds_are_by_register_before_unit() -> None:
    def beyond(**thresholds: float) -> int:
        beside = Beside(Stuck(MARVIN, 3), **thresholds)
        beside.go(600)
        beside.read_all("present_position", 3.0)
        return len(beside.told)

    assert beyond() == 1
    assert beyond(rad=1.0) == 0
    assert beyond(present_position=1.0) == 0
    assert beyond(present_position=0.1, rad=1.0) == 1


def test_a_packet_that_comes_in_parts_is_whole_for_the_shadow() -> None:
    beside = Beside(Stuck(MARVIN, 3))
    beside.go()
    beside.read_all("present_position", 4.0, cut=5)
    assert [parting.servo_id for parting in beside.told] == [3]


def test_a_shadow_answers_what_a_usb2ax_reads_by_itself() -> None:
    robot, told = load_robot("phantomx"), []
    real = assemble(robot, ideal(robot), load_profile("usb2ax"), start_s=5.0)
    shadow = Shadow(robot, ideal(robot), 5.0, told.append)
    decoder = WireDecoder(1.0, robot.tables, shadow.seen)
    register = robot.tables[1]["present_voltage"]
    parameters = bytes([register.address, 1, *range(1, 19)])
    for now_s in (5.1, 5.2):
        packet = InstructionPacket(0xFD, Instruction.USB2AX_SYNC_READ, parameters)
        data = v1.encode_instruction(packet)
        shadow.sent(data, now_s, 1_000_000)
        decoder.sent(data, now_s)
        real.poll(now_s)
        real.receive(data, now_s)
        decoder.received(real.poll(now_s + 0.09), now_s + 0.09)
    assert sum(pair.compared for pair in shadow.pairs.values()) == 36
    assert told == []


@pytest.mark.parametrize("words", ["rad", "rad=", "rad=-1", "rad=x", "=nan"])
def test_threshold_that_is_none_is_said(words: str) -> None:
    with pytest.raises(ShadowError, match="--threshold"):
        parse_thresholds([words])
    assert parse_thresholds(["rad=0.05", "present_load=1"]) == {"rad": 0.05, "present_load": 1.0}


def test_shadow_of_another_robot_is_refused() -> None:
    with pytest.raises(ShadowError, match="not the servos of phantomx"):
        Beside().shadow.check(load_robot("phantomx"))


@pytest.mark.pty
def test_tap_says_live_and_at_the_end_where_the_two_part(tmp_path: Path) -> None:
    text = MARVIN.path.read_text("utf-8")
    assert "\nid = 3\n" in text
    weak = tmp_path / "weak.toml"  # servo 3 has no torque
    weak.write_text(text.replace("\nid = 3\n", "\nid = 3\nregisters = { max_torque = 0 }\n"))
    run = [sys.executable, "-m", "busemu"]
    real, link = tmp_path / "real", tmp_path / "link"
    tap = ["--device", real, "--robot", "marvin", "--link", link, "--record", tmp_path / "r.csv"]
    shadow = ["--shadow", "marvin", "--shadow-plant", "ideal"]
    serve = ["--robot", weak, "--timing", "ideal", "--plant", "ideal", "--link", real]
    processes = []
    try:
        for words in (["serve", *serve], ["tap", *tap, *shadow]):
            process = subprocess.Popen([*run, *map(str, words)], stdout=subprocess.PIPE)
            processes.append(process)
            while not process.stdout.readline().startswith(b"try:"):
                assert process.poll() is None
        port, sdk = PortHandler(str(link)), PacketHandler(2.0)
        assert port.setBaudRate(1_000_000)
        for servo_id in range(1, 19):
            sdk.write1ByteTxRx(port, servo_id, 24, 1)
            sdk.write2ByteTxRx(port, servo_id, 30, 700)
        group = GroupSyncRead(port, sdk, 37, 2)
        for servo_id in range(1, 19):
            group.addParam(servo_id)
        said = ""
        while "servo 3 present_position: expected" not in said:
            group.txRxPacket()
            if select.select([processes[1].stdout], [], [], 0.0)[0]:
                part = os.read(processes[1].stdout.fileno(), 65536).decode()
                assert part, said
                said += part
        port.closePort()
        processes[1].send_signal(signal.SIGINT)
        rest, _ = processes[1].communicate(timeout=PATIENCE_S)
        assert processes[1].returncode == 0
    finally:
        for process in processes:
            process.kill()
            process.wait()
            process.stdout.close()
    rest = rest.decode()
    assert re.search(r"^shadow: \d+ readings compared, 1 register parted", rest, re.MULTILINE)
    assert re.search(r"servo 3 present_position: first at .*still apart", rest)
