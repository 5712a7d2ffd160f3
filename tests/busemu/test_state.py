"""EEPROM that lasts: what is kept, when, and what is refused."""

from __future__ import annotations

import errno
import os
import resource
import signal
import time
import tomllib
from pathlib import Path

import pytest
from dynamixel_sdk import PacketHandler, PortHandler
from programs import until
from pty_server import serving
from virtual_bus import AX, XL, Bench, ScriptedPlant, small_robot

from busemu.protocol import Instruction
from busemu.state import FORMAT, State, StateError
from busemu.tables import Robot


def kept(path: Path, robot: Robot | None = None, **bench: object) -> tuple[Bench, State]:
    bench = Bench(robot or small_robot(XL), **bench)
    return bench, State(path, bench.robot, bench.bus.servos)


def test_what_is_written_to_eeprom_is_there_after_a_start(tmp_path: Path) -> None:
    bench, state = kept(tmp_path / "s.toml")
    bench.set("return_delay_time", 7, 2)
    bench.set("max_torque", 600, 2)
    bench.set("led", 5, 2)
    bench.set("id", 9, 3)
    state.save()
    state.close()
    again, _ = kept(tmp_path / "s.toml")
    assert [again.ping(i)[1] for i in (1, 2, 3, 9)] == [0, 0, -3001, 0]
    assert again.get("return_delay_time", 2) == 7
    assert again.get("torque_limit", 2) == again.get("max_torque", 2) == 600
    assert again.get("led", 2) == 0


def test_backup_lasts_too(tmp_path: Path) -> None:
    robot = small_robot("XM430-W350")
    bench, state = kept(tmp_path / "s.toml", robot, plant=ScriptedPlant.of_twelve_volts())
    bench.set("homing_offset", 50, 1)
    assert bench.instruct(Instruction.CONTROL_TABLE_BACKUP, b"\x01CTRL").error == 0
    bench.set("homing_offset", 0, 1)
    state.save()
    state.close()
    again, _ = kept(tmp_path / "s.toml", robot, plant=ScriptedPlant.of_twelve_volts())
    assert (again.get("homing_offset"), again.get("backup_ready")) == (0, 1)
    assert again.instruct(Instruction.CONTROL_TABLE_BACKUP, b"\x02CTRL").error == 0
    again.sleep(1.0)
    assert again.get("homing_offset") == 50


def test_the_file_is_made_at_once_and_says_whose_it_is(tmp_path: Path) -> None:
    bench, _ = kept(tmp_path / "s.toml")
    document = tomllib.loads((tmp_path / "s.toml").read_text("utf-8"))
    assert (document["format"], document["robot"]) == (FORMAT, bench.robot.name)
    assert document["servo"]["j2"]["model"] == XL
    eeprom = {r.name for r in bench.table.registers if r.area == "EEPROM" and r.writable}
    assert set(document["servo"]["j2"]) - {"model"} == eeprom
    assert list(tmp_path.iterdir()) == [tmp_path / "s.toml"]


def test_only_a_change_of_eeprom_writes_the_file(tmp_path: Path) -> None:
    bench, state = kept(tmp_path / "s.toml")

    def inode_after(name: str, value: int) -> int:
        bench.set(name, value)
        state.save()
        return (tmp_path / "s.toml").stat().st_ino

    before = inode_after("led", 1)
    assert inode_after("goal_position", 300) == before
    assert bench.write("return_delay_time", 255)[1] != 0
    assert inode_after("led", 2) == before
    assert inode_after("return_delay_time", 5) != before


def test_a_factory_reset_is_kept(tmp_path: Path) -> None:
    bench, state = kept(tmp_path / "s.toml")
    bench.set("return_delay_time", 5, 2)
    state.save()
    bench.instruct(Instruction.FACTORY_RESET, b"\x02", servo_id=2)
    state.save()
    state.close()
    again, _ = kept(tmp_path / "s.toml")
    assert again.get("return_delay_time", 2) == again.table["return_delay_time"].initial


def full(file: int) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_write_that_fails_leaves_the_old_file(tmp_path: Path, monkeypatch) -> None:
    bench, state = kept(tmp_path / "s.toml")
    before = (tmp_path / "s.toml").read_bytes()
    bench.set("return_delay_time", 5)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StateError, match="No space left"):
        state.save()
    assert (tmp_path / "s.toml").read_bytes() == before
    assert list(tmp_path.iterdir()) == [tmp_path / "s.toml"]


def test_what_the_disk_did_not_take_is_tried_once_more_where_asked(
    tmp_path: Path, monkeypatch
) -> None:
    bench, state = kept(tmp_path / "s.toml")
    bench.set("return_delay_time", 5)
    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", full)
        with pytest.raises(StateError, match="No space left"):
            state.save()
        state.save()  # nothing new
        with pytest.raises(StateError, match="No space left"):
            state.save(again=True)
    state.save(again=True)
    state.close()
    again, _ = kept(tmp_path / "s.toml")
    assert again.get("return_delay_time", 1) == 5


def test_a_disk_that_takes_only_a_part_leaves_the_old_file(tmp_path: Path) -> None:
    bench, state = kept(tmp_path / "s.toml")
    before = (tmp_path / "s.toml").read_bytes()
    bench.set("return_delay_time", 5)
    room, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) // 2, most))
    try:
        with pytest.raises(StateError, match="File too large"):
            state.save()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, most))
    assert (tmp_path / "s.toml").read_bytes() == before
    assert list(tmp_path.iterdir()) == [tmp_path / "s.toml"]


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path, Path("/dev/zero")):
        with pytest.raises(StateError, match="is no file; choose another name"):
            kept(path)


def test_servos_that_are_not_where_the_robot_has_them_are_named(tmp_path: Path) -> None:
    bench, state = kept(tmp_path / "s.toml")
    assert state.describe() == []
    bench.set("id", 9, 3)
    state.save()
    state.close()
    _, again = kept(tmp_path / "s.toml")
    (line,) = again.describe()
    assert "servo j3 has ID 9 and 1000000 baud there" in line


def test_two_servers_cannot_keep_the_same_file(tmp_path: Path) -> None:
    bench, state = kept(tmp_path / "s.toml")
    for _ in range(2):
        with pytest.raises(StateError, match="another server"):
            kept(tmp_path / "s.toml")
        bench.set("return_delay_time", 5)
        state.save()  # the lock goes over to the new file
    state.close()
    kept(tmp_path / "s.toml")


def changed(old: str, new: str) -> object:
    def change(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (changed('robot = "small"', 'robot = "large"'), "is of robot 'large', not 'small'"),
        (changed('model = "XL-320"', 'model = "AX-12A"'), "servo j1: is a 'AX-12A' there"),
        (changed('[servo."j3"]', '[servo."elbow"]'), "not those of small .elbow, j3."),
        (changed("return_delay_time = 250", "return_delay_time = 255"), "not a value it can have"),
        (changed("return_delay_time = 250", "return_delay_time = 1.5"), "not a value it can have"),
        (changed("return_delay_time = 250", "goal_position = 1"), "keeps no register 'goal_pos"),
        (changed(FORMAT, "busemu-robot/1"), "not a state file"),
        (lambda text: text[: len(text) // 2].rstrip("0123456789\n "), "not a TOML file"),
        (lambda text: "", "not a state file"),
    ],
)
def test_another_robots_and_damaged_files_are_refused(tmp_path: Path, change, said: str) -> None:
    path = tmp_path / "s.toml"
    kept(path)[1].close()
    path.write_text(change(path.read_text("utf-8")), "utf-8")
    before = path.read_bytes()
    with pytest.raises(StateError, match=said) as raised:
        kept(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)
    assert path.read_bytes() == before


def test_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(StateError, match="there is no folder"):
        kept(tmp_path / "no" / "s.toml")


@pytest.mark.pty
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_served_bus_keeps_its_eeprom_over_any_end(tmp_path: Path, number: int) -> None:
    path = tmp_path / "s.toml"
    arguments = ("--robot", "phantomx", "--timing", "ideal", "--state", path)
    with serving(*arguments) as server:
        port = PortHandler(server.path)
        assert port.setBaudRate(1_000_000)
        until(lambda: PacketHandler(1.0).write1ByteTxRx(port, 3, 5, 77) == (0, 0))
        until(lambda: b"return_delay_time = 77" in path.read_bytes())
        port.closePort()
        server.end(number)
    with serving(*arguments) as server:
        port = PortHandler(server.path)
        assert port.setBaudRate(1_000_000)
        until(lambda: PacketHandler(1.0).read1ByteTxRx(port, 3, 5) == (77, 0, 0))
        port.closePort()
    assert [found.name for found in tmp_path.iterdir()] == ["s.toml"]


@pytest.mark.pty
def test_a_kill_amid_writes_leaves_a_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    arguments = ("--robot", "phantomx", "--timing", "ideal", "--state", path)
    for turn in range(5):
        with serving(*arguments) as server:
            port = PortHandler(server.path)
            port.setBaudRate(1_000_000)
            end_s = time.monotonic() + 0.03 * turn
            value = 0
            while time.monotonic() < end_s:
                value = (value + 1) % 250
                PacketHandler(1.0).write1ByteTxRx(port, 3, 5, value)
            server.end(signal.SIGKILL)
            port.closePort()
        assert tomllib.loads(path.read_text("utf-8"))["format"] == FORMAT


def test_another_robots_file_ends_the_server_with_one_line(tmp_path: Path) -> None:
    bench = Bench(AX)
    State(tmp_path / "s.toml", bench.robot, bench.bus.servos).close()
    said = r"busemu: --state .*is of robot 'small'"
    with (
        pytest.raises(AssertionError, match=said) as raised,
        serving("--robot", "phantomx", "--state", tmp_path / "s.toml"),
    ):
        pass
    assert "Traceback" not in str(raised.value)
