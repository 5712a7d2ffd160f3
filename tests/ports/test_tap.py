"""`busemu tap` before an emulated bus: what it records, whoever the program is, however it ends."""

from __future__ import annotations

import math
import os
import signal
import statistics
import subprocess
import sys
import time
import tty
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest
from dynamixel_sdk import GroupSyncRead
from port_programs import (
    IDS,
    OK,
    TIMEOUT,
    Program,
    meets,
    refused,
    running,
    serving,
)
from programs import PATIENCE_S, sdk, until
from pypot.dynamixel.io import Dxl320IO, DxlIO
from pypot.dynamixel.io.abstract_io import DxlTimeoutError

from bench.recording import Recording, read
from busemu.ports import device as device_module
from busemu.ports.baud import get_baud_rate, set_baud_rate
from busemu.ports.device import SerialDevice
from busemu.ports.pty import PtyPort
from busemu.ports.tap import Tap

pytestmark = pytest.mark.pty

ATTEMPTS = 4

PING = b"\xff\xff\xfd\x00\x01\x03\x00\x01\x19\x4e"


class DisturbedError(Exception):
    """The machine was too busy for replies to come in time: try once more."""


def undisturbed(attempt: Callable[[Path], None], folder: Path) -> None:
    """Run an attempt in folders of its own, until replies are not lost to a busy machine."""
    for n in range(ATTEMPTS):
        (folder / str(n)).mkdir()
        with suppress(DisturbedError):
            return attempt(folder / str(n))
    pytest.fail(f"replies were lost to a busy machine in each of {ATTEMPTS} attempts")


def tapping(device: object, robot: str, record: Path, *words: object) -> Any:
    return running("tap", "--device", device, "--robot", robot, "--record", record, *words)


def assert_same(one: Recording, two: Recording) -> None:
    """The same accesses in the same order, with the same values, lost replies at the same places.

    Raises :class:`DisturbedError` where a reply is lost for one alone: on a busy machine it may
    come in the very instant in which a program gives it up.
    """
    keys, raws = [], []
    for recording in (one, two):
        table = recording.table
        keys.append(table.select(["servo_id", "op", "register"]).to_pylist())
        raws.append(table.column("raw").to_pylist())
    lost = [[math.isnan(raw) for raw in raws[side]] for side in (0, 1)]
    if len(keys[0]) == len(keys[1]) and lost[0] != lost[1]:
        raise DisturbedError
    assert keys[0] == keys[1]
    assert [raw for raw in raws[0] if raw == raw] == [raw for raw in raws[1] if raw == raw]


def rows(recording: Recording, servo_id: int, register: str, op: str) -> list[float]:
    return recording.series(servo_id, register, op).value.tolist()


# -- the tap itself -------------------------------------------------------------------------------


def test_bytes_pass_both_ways_in_order_with_rising_times() -> None:
    board, end = os.openpty()
    tty.setraw(end)
    everything = bytes(range(256))
    with closing(SerialDevice(os.ttyname(end), 115_200)) as device, closing(PtyPort()) as port:
        tap = Tap(port, device)
        assert get_baud_rate(port.fileno()) == 115_200
        client = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
        for _ in range(3):
            os.write(client, everything)
            assert tap.turn(PATIENCE_S)
            assert os.read(board, 1000) == everything
            os.write(board, everything[::-1])
            assert tap.turn(PATIENCE_S)
            assert os.read(client, 1000) == everything[::-1]
        assert not tap.turn(0.0)
        assert [chunk.from_host for chunk in tap.passed] == [True, False] * 3
        assert b"".join(c.data for c in tap.passed) == (everything + everything[::-1]) * 3
        times_s = [chunk.t_s for chunk in tap.passed]
        assert times_s == sorted(times_s)
        os.close(client)
    os.close(board)
    os.close(end)


def test_device_that_is_slow_to_take_bytes_gets_all_of_them() -> None:
    board, end = os.openpty()
    tty.setraw(end)
    with closing(SerialDevice(os.ttyname(end), 115_200)) as device, closing(PtyPort()) as port:
        tap = Tap(port, device)
        client = os.open(port.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        data = bytes(i % 251 for i in range(100_000))
        written, got = 0, bytearray()
        os.set_blocking(board, False)
        end_s = time.monotonic() + PATIENCE_S
        while len(got) < len(data):
            assert time.monotonic() < end_s, f"{len(got)} bytes of {written}"
            with suppress(BlockingIOError):
                written += os.write(client, data[written : written + 4096])
            for _ in range(4):
                tap.turn(0.0)
            with suppress(BlockingIOError):
                got += os.read(board, 1000)  # less than comes
        assert got == data
        assert b"".join(chunk.data for chunk in tap.passed) == data
        os.close(client)
    os.close(board)
    os.close(end)


def test_baud_rate_that_the_device_refuses_meets_silence_and_a_good_one_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def choosy(descriptor: int, baud_rate: int) -> int:
        return baud_rate if baud_rate < 4_000_000 else 3_000_000

    board, end = os.openpty()
    monkeypatch.setattr(device_module, "set_baud_rate", choosy)
    with closing(SerialDevice(os.ttyname(end), 115_200)) as device, closing(PtyPort()) as port:
        tap = Tap(port, device)
        client = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
        os.set_blocking(board, False)
        for baud_rate in (4_500_000, 1_000_000):
            set_baud_rate(client, baud_rate)
            os.write(client, b"hello")
            assert tap.turn(PATIENCE_S)
            if baud_rate == 4_500_000:
                assert "does not offer 4500000 baud (it took 3000000)" in tap.refused
                with pytest.raises(BlockingIOError):
                    os.read(board, 10)
        assert tap.refused == ""
        assert os.read(board, 10) == b"hello"
        assert len(tap.passed) == 1
        os.close(client)
    os.close(board)
    os.close(end)


# -- recordings -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["phantomx", "marvin"])
def test_walk_through_a_tap_is_recorded_as_the_walk_recorded_it(tmp_path: Path, name: str) -> None:
    undisturbed(lambda folder: walk_through_a_tap(folder, name), tmp_path)


def walk_through_a_tap(tmp_path: Path, name: str) -> None:
    taps, walk = tmp_path / "tap.parquet", tmp_path / "walk.parquet"
    link = tmp_path / "port"
    with (
        serving("--robot", name) as server,
        tapping(server.path, name, taps, "--link", link, "--group", "lab") as tap,
    ):
        words = ["walk", "--robot", name, "--port", str(link), "--seconds", "2"]
        done = subprocess.run(
            [sys.executable, "-m", "busemu", *words, "--record", str(walk)],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        code, said = tap.end()
        assert code == 0, said
    one, two = read(taps), read(walk)
    if " 0 lost replies" not in done.stdout:
        raise DisturbedError
    assert_same(one, two)
    assert len(one) > 1000
    assert one.metadata["source"] == "emulator"
    assert one.metadata["group"] == "lab"
    assert {k: one.metadata[k] for k in ("robot", "bus", "servo")} == {
        k: two.metadata[k] for k in ("robot", "bus", "servo")
    }
    for column in ("t_s", "t_reply_s"):
        pairs = zip(*(r.table.column(column).to_pylist() for r in (one, two)), strict=True)
        apart_s = [abs(a - b) for a, b in pairs if a == a]
        assert statistics.median(apart_s) < 0.003
    assert not link.is_symlink()


def test_sdk_through_two_taps_in_a_row_gets_what_both_record(tmp_path: Path) -> None:
    undisturbed(two_taps_in_a_row, tmp_path)


def two_taps_in_a_row(tmp_path: Path) -> None:
    paths = [tmp_path / "near.parquet", tmp_path / "far.csv"]
    with (
        serving("--robot", "marvin") as server,
        tapping(server.path, "marvin", paths[1]) as far,
        tapping(far.path, "marvin", paths[0]) as near,
    ):
        with sdk(near.path, 2.0) as (port, packets):
            assert meets((OK, 0), lambda: packets.write2ByteTxRx(port, 3, 30, 600))
            assert meets((600, OK, 0), lambda: packets.read2ByteTxRx(port, 3, 30))
            assert meets((OK, 0), lambda: packets.regWriteTxRx(port, 4, 30, 2, [0x58, 2]))
            assert packets.action(port, 4) == OK
            read_all = GroupSyncRead(port, packets, 37, 2)
            for servo_id in IDS:
                read_all.addParam(servo_id)
            assert meets(OK, read_all.txRxPacket)
            assert packets.read2ByteTxRx(port, 99, 37)[1] == TIMEOUT
        for tap in (near, far):
            code, said = tap.end()
            assert code == 0, said
    one, two = (read(path) for path in paths)
    assert_same(one, two)
    assert set(rows(one, 3, "goal_position", "write")) == {600}
    assert set(rows(one, 3, "goal_position", "read")) == {600}
    assert set(rows(one, 4, "goal_position", "write")) == {600}
    assert all(len(rows(one, i, "present_position", "read")) >= 1 for i in IDS)
    assert one.table.column("register").to_pylist()[-1] == "wire/servo_99/byte_38"


@pytest.mark.parametrize("name", ["phantomx", "marvin"])
def test_pypot_through_a_tap(tmp_path: Path, name: str) -> None:
    make = DxlIO if name == "phantomx" else Dxl320IO
    path = tmp_path / "pypot.parquet"
    with serving("--robot", name) as server, tapping(server.path, name, path) as tap:
        with closing(make(tap.path, baudrate=1_000_000, timeout=0.2)) as io:
            assert io.scan([1, 2, 18, 19]) == [1, 2, 18]
            until(lambda: (io.enable_torque(IDS), all(io.is_torque_enabled(IDS)))[1])
            until(lambda: (io.set_goal_position({5: 20.0}), io.get_goal_position([5])[0] > 19)[1])
            assert len(io.get_present_position(IDS)) == 18
        code, said = tap.end()
        assert code == 0, said
    recording = read(path)
    goal = rows(recording, 5, "goal_position", "write")[-1]
    assert rows(recording, 5, "goal_position", "read")[-1] == goal > 512
    assert all(1.0 in rows(recording, i, "torque_enable", "read") for i in IDS)
    assert all(len(rows(recording, i, "present_position", "read")) >= 1 for i in IDS)


def test_sync_reads_of_pypot_on_a_usb2ax_are_recorded(tmp_path: Path) -> None:
    path = tmp_path / "usb2ax.parquet"
    arguments = ("--robot", "phantomx", "--timing", "usb2ax")
    with serving(*arguments) as server, tapping(server.path, "phantomx", path) as tap:
        with closing(DxlIO(tap.path, timeout=0.5, use_sync_read=True)) as io:

            def read_all() -> bool:
                with suppress(DxlTimeoutError):
                    return len(io.get_present_position(IDS)) == 18
                return False

            until(read_all)
        code, said = tap.end()
        assert code == 0, said
    recording = read(path)
    for servo_id in IDS:
        assert rows(recording, servo_id, "present_position", "read")[-1] == 512


def test_baud_rate_of_the_program_is_that_of_the_device(tmp_path: Path) -> None:
    path = tmp_path / "tap.parquet"
    with serving("--robot", "marvin") as server, tapping(server.path, "marvin", path) as tap:
        for baud_rate, result in ((57_600, TIMEOUT), (1_000_000, OK), (123_456, TIMEOUT)):
            descriptor = os.open(server.path, os.O_RDWR | os.O_NOCTTY)
            with sdk(tap.path, 2.0, 57_600) as (port, packets):
                port.ser.baudrate = baud_rate
                assert meets(result, lambda: packets.ping(port, 1)[1])
                until(lambda: get_baud_rate(descriptor) == baud_rate)  # noqa: B023
            os.close(descriptor)
        with sdk(tap.path, 2.0) as (port, packets):
            assert meets(OK, lambda: packets.read2ByteTxRx(port, 1, 37)[1])
        assert tap.end()[0] == 0
    assert read(path).metadata["bus"]["baud_rate"] == 1_000_000


# -- endings --------------------------------------------------------------------------------------


def ask_something(tap: Program) -> None:
    with sdk(tap.path, 2.0) as (port, packets):
        assert meets(OK, lambda: packets.read2ByteTxRx(port, 1, 37)[1])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signal_ends_the_tap_and_writes_the_recording(tmp_path: Path, number: int) -> None:
    path, link = tmp_path / "tap.parquet", tmp_path / "port"
    with (
        serving("--robot", "marvin") as server,
        tapping(server.path, "marvin", path, "--link", link) as tap,
    ):
        ask_something(tap)
        assert not path.exists()
        code, said = tap.end(number)
        assert code == 0, said
        assert said.splitlines()[-1].startswith(f"recorded {path}: ")
    assert len(read(path)) >= 1
    assert {p.name for p in tmp_path.iterdir()} == {"tap.parquet"}


def test_killed_tap_leaves_no_file_and_no_link(tmp_path: Path) -> None:
    path, link = tmp_path / "tap.parquet", tmp_path / "port"
    with (
        serving("--robot", "marvin") as server,
        tapping(server.path, "marvin", path, "--link", link) as tap,
    ):
        ask_something(tap)
        tap.end(signal.SIGKILL)
        until(lambda: not link.is_symlink())
        assert list(tmp_path.iterdir()) == []


def test_device_that_disappears_ends_the_tap_and_the_recording_is_written(tmp_path: Path) -> None:
    path = tmp_path / "tap.parquet"
    with serving("--robot", "marvin") as server, tapping(server.path, "marvin", path) as tap:
        ask_something(tap)
        server.end(signal.SIGKILL)
        code, said = tap.end(None)
        assert code == 1
        assert said.splitlines()[-2].startswith(f"recorded {path}: ")
        assert said.splitlines()[-1].startswith(f"busemu: {server.path}: the device has gone")
    assert len(read(path)) >= 1


def test_emulated_bus_whose_link_is_gone_at_the_end_is_no_real_robot(tmp_path: Path) -> None:
    path, device = tmp_path / "tap.parquet", tmp_path / "servos"
    with serving("--robot", "marvin") as server:
        device.symlink_to(server.path)
        with tapping(device, "marvin", path) as tap:
            ask_something(tap)
            device.unlink()
            assert tap.end()[0] == 0
    assert read(path).metadata["source"] == "emulator"


def test_tap_through_which_nothing_passed_writes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "tap.parquet"
    with serving("--robot", "marvin") as server, tapping(server.path, "marvin", path) as tap:
        code, said = tap.end()
        assert code == 0
        assert said.splitlines()[-1] == "nothing was read or written: no recording"
    assert list(tmp_path.iterdir()) == []


def test_mistakes_are_one_clear_line(tmp_path: Path) -> None:
    record = ("--record", tmp_path / "tap.parquet")
    gone = ("--device", tmp_path / "ttyUSB7")
    assert "no such device" in refused("tap", "--robot", "marvin", *gone, *record)
    assert "r2d2" in refused("tap", "--robot", "r2d2", *gone, *record)
    assert ".parquet or .csv" in refused(
        "tap", "--robot", "marvin", *gone, "--record", tmp_path / "tap.txt"
    )
    assert "no folder" in refused(
        "tap", "--robot", "marvin", *gone, "--record", tmp_path / "a" / "tap.csv"
    )
    with serving("--robot", "marvin") as server:
        words = ("--robot", "marvin", "--device", server.path)
        taken = tmp_path / "file"
        taken.write_text("chapter 1", "utf-8")
        assert "file of that name" in refused("tap", *words, *record, "--link", taken)
        with tapping(server.path, "marvin", record[1]):
            assert "busy" in refused("tap", *words, *record)
    assert {p.name for p in tmp_path.iterdir()} == {"file"}
