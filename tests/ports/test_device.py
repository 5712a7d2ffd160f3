"""`busemu serve --device`: a pseudo-terminal stands for the line to a real control board."""

from __future__ import annotations

import fcntl
import os
import select
import statistics
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest
from port_programs import OK, meets, refused, serving
from programs import PATIENCE_S, sdk

from busemu.ports import device as device_module
from busemu.ports.baud import get_baud_rate
from busemu.ports.device import DeviceError, DeviceLostError, SerialDevice

pytestmark = pytest.mark.pty

PING = b"\xff\xff\xfd\x00\x01\x03\x00\x01\x19\x4e"


class Cable:
    """A line of which this process holds the board's end, and `path` is the other."""

    def __init__(self) -> None:
        self.board, self._end = os.openpty()  # cooked, as the kernel makes it
        self.path = os.ttyname(self._end)

    def exchange(self, data: bytes, size: int) -> tuple[bytes, float]:
        """The answer to ``data``, and how long its last byte took [s]."""
        start_s = time.monotonic()
        os.write(self.board, data)
        answer = b""
        while len(answer) < size and time.monotonic() - start_s < PATIENCE_S:
            answer += os.read(self.board, size - len(answer))
        return answer, time.monotonic() - start_s

    def unplug(self) -> None:
        with suppress(OSError):
            os.close(self.board)

    def close(self) -> None:
        self.unplug()
        os.close(self._end)


@pytest.fixture
def cable() -> Iterator[Cable]:
    with closing(Cable()) as made:
        yield made


# -- the device itself ----------------------------------------------------------------------------


@pytest.mark.parametrize("baud_rate", [9600, 57_600, 1_000_000, 4_500_000, 123_456])
def test_device_takes_any_baud_rate_and_passes_all_bytes(cable: Cable, baud_rate: int) -> None:
    with closing(SerialDevice(cable.path, baud_rate, low_latency=True)) as device:
        assert get_baud_rate(device.fileno()) == device.baud_rate() == baud_rate
        everything = bytes(range(256))
        os.write(cable.board, everything)
        assert device.wait(PATIENCE_S)
        assert device.read() == everything
        assert device.read() == b""
        device.write(everything)
        assert os.read(cable.board, 1000) == everything


def test_device_that_goes_is_lost_and_says_so(cable: Cable) -> None:
    with closing(SerialDevice(cable.path, 1_000_000)) as device:
        cable.unplug()
        assert device.wait(PATIENCE_S)
        with pytest.raises(DeviceLostError, match="has gone"):
            device.read()
        with pytest.raises(DeviceLostError, match="has gone"):
            device.send(b"x")


def test_device_in_use_is_refused_until_it_is_free(cable: Cable) -> None:
    with closing(SerialDevice(cable.path, 1_000_000)), pytest.raises(DeviceError, match="busy"):
        SerialDevice(cable.path, 1_000_000)
    SerialDevice(cable.path, 1_000_000).close()


def test_device_without_the_baud_rate_is_refused(
    cable: Cable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device_module, "set_baud_rate", lambda descriptor, rate: 115_200)
    with pytest.raises(DeviceError, match=r"does not offer 1000000 baud \(it took 115200\)"):
        SerialDevice(cable.path, 1_000_000)
    monkeypatch.setattr(device_module, "set_baud_rate", lambda descriptor, rate: rate + rate // 50)
    SerialDevice(cable.path, 1_000_000).close()


def test_file_that_is_no_serial_port_is_refused(tmp_path: Path) -> None:
    plain = tmp_path / "thesis.txt"
    plain.write_text("chapter 1", "utf-8")
    for path in (plain, tmp_path, Path("/dev/null")):
        with pytest.raises(DeviceError, match="not a serial port"):
            SerialDevice(str(path), 1_000_000)
    assert plain.read_text("utf-8") == "chapter 1"


# -- serving on it --------------------------------------------------------------------------------


def test_board_on_a_real_line_gets_its_answers_in_the_servos_time(cable: Cable) -> None:
    """A read through Marvin's own adapter takes 3 ms; on a real line the servo's 0.5 ms is left."""
    with serving("--robot", "marvin", "--device", cable.path) as server:
        times_s = []
        for _ in range(100):
            answer, took_s = cable.exchange(PING, 14)
            assert answer.startswith(b"\xff\xff\xfd\x00\x01\x07\x00\x55")
            times_s.append(took_s)
        assert min(times_s) >= 0.0005
        assert statistics.median(times_s) < 0.0025
        assert "timing thesis-marvin (servos only)" in server.said
        code, said = server.end()
        assert code == 0, said


def test_sdk_on_the_other_end_of_a_null_cable_is_served(cable: Cable) -> None:
    board, other = os.openpty()
    tty.setraw(other)
    path = os.ttyname(other)
    with (
        closing(NullCable(cable.board, board)),
        serving("--robot", "phantomx", "--device", cable.path),
        sdk(path, 1.0) as (port, packets),
    ):
        assert meets((12, OK, 0), lambda: packets.ping(port, 1))
        assert meets((OK, 0), lambda: packets.write2ByteTxRx(port, 1, 30, 600))
        assert meets((600, OK, 0), lambda: packets.read2ByteTxRx(port, 1, 30))
    os.close(board)
    os.close(other)


class NullCable:
    """Joins the masters of two pseudo-terminals, as a null cable joins two ports."""

    def __init__(self, one: int, two: int) -> None:
        self._other = {one: two, two: one}
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._pass_on)
        self._thread.start()

    def _pass_on(self) -> None:
        while not self._closed.is_set():
            for end in select.select(list(self._other), [], [], 0.05)[0]:
                os.write(self._other[end], os.read(end, 4096))

    def close(self) -> None:
        self._closed.set()
        self._thread.join()


def test_server_whose_adapter_is_unplugged_ends_with_one_line(cable: Cable) -> None:
    with serving("--robot", "marvin", "--device", cable.path) as server:
        cable.exchange(PING, 14)
        cable.unplug()
        code, said = server.end(None)
        assert code == 1
        assert said.splitlines()[-1].startswith(f"busemu: {cable.path}: the device has gone")


def test_mistakes_are_one_clear_line(cable: Cable, tmp_path: Path) -> None:
    serve = ("serve", "--robot", "marvin", "--plant", "ideal", "--device")
    assert "no such device" in refused(*serve, tmp_path / "ttyUSB7")
    assert "not a serial port" in refused(*serve, "/dev/null")
    holder = os.open(cable.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    assert "busy" in refused(*serve, cable.path)
    os.close(holder)
    assert "exclude each other" in refused(*serve, cable.path, "--tcp", "127.0.0.1:0")
