"""Faults of a served bus, over a real pseudo-terminal, with real commands."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
from contextlib import suppress

import pytest
import serial
from dynamixel_sdk import PacketHandler, PortHandler
from fault_bench import FaultBench
from programs import busemu, until
from pty_server import serving
from virtual_bus import OK, TIMEOUT, XL

from busemu.control import ControlError, _address, ask, servers

pytestmark = pytest.mark.pty
SDK = PacketHandler(2.0)


@pytest.fixture
def link(tmp_path):
    return tmp_path / "bus"


def opened(path) -> PortHandler:
    port = PortHandler(str(path))
    port.openPort()
    port.setBaudRate(1_000_000)
    return port


def answers(port, servo_id=1):
    """Whether a servo answers; on a busy machine it may take more than one ping."""
    try:
        until(lambda: SDK.ping(port, servo_id)[1] == OK)
    except AssertionError:
        return False
    return True


def fault(*words):
    """Run `busemu fault`; its exit code and what it said."""
    done = busemu("fault", *words, timeout_s=60.0)
    return done.returncode, done.stdout + done.stderr


def add(link, **fields):
    answer = ask(str(link), {"do": "add", "fault": fields})
    assert "error" not in answer, answer
    return answer["number"]


def what_fails(port, device):
    """The errors that each use of the SDK's port gives, on a bus that is unplugged."""
    uses = {
        "clear": port.clearPort,
        "available": port.getBytesAvailable,
        "write": lambda: port.writePort(b"\xff"),
        "read": lambda: port.readPort(1),
        "open another": lambda: device().openPort(),
    }
    found = {}
    for name, use in uses.items():
        try:
            use()
        except Exception as error:
            found[name] = type(error)
        else:
            found[name] = None
    return found


def test_a_scenario_strikes_and_shows_in_the_trace(link, tmp_path):
    scenario, trace = tmp_path / "faults.toml", tmp_path / "bus.trace"
    scenario.write_text(
        'format = "busemu-faults/1"\n[[fault]]\nkind = "drop"\nservo = 3\ncount = 2\n', "utf-8"
    )
    options = ("--robot", "marvin", "--link", link, "--faults", scenario, "--trace", trace)
    with serving(*options) as server:
        port = opened(link)
        assert [SDK.ping(port, 3)[1] for _ in range(2)] == [TIMEOUT, TIMEOUT]
        assert answers(port, 3)
        server.end()
    decode = [sys.executable, "-m", "busemu", "decode", str(trace)]
    said = subprocess.run(decode, capture_output=True, text=True, check=True, timeout=60).stdout
    assert said.count("* drop: reply of servo 3 to ping") == 2
    assert re.search(r"^[0-9]+ packets, 0 bad$", said, re.MULTILINE)
    monitor = [sys.executable, "-m", "busemu", "monitor", "--once", str(trace)]
    said = subprocess.run(monitor, capture_output=True, text=True, check=True, timeout=60).stdout
    assert said.split("faults that struck")[1].split()[:4] == ["fault", "struck", "drop", "2"]


def test_faults_come_and_go_by_command(link):
    with serving("--robot", "marvin", "--link", link):
        port = opened(link)
        assert fault("drop", "--servo", 3, "--port", link) == (0, "fault 1: drop servo 3\n")
        assert SDK.ping(port, 3)[1] == TIMEOUT
        code, said = fault("list", "--port", link)
        assert code == 0
        assert said.splitlines()[1].split() == ["1", "active", "1", "drop", "servo", "3"]
        code, said = fault("brown-out", "--servo", 30, "--port", link)
        assert code == 1
        assert said.startswith("busemu: fault: servo 30 is not on marvin: its IDs are 1, 2,")
        code, said = fault("clear", "dorp", "--port", link)
        assert code == 1
        assert "'dorp' is no number and no kind" in said
        code, said = fault("clear", 2, "--port", link)
        assert code == 1
        assert "there is no fault 2" in said
        assert fault("clear", 1, "--port", link) == (0, "ended 1 fault\n")
        assert fault("clear", 1, "--port", link) == (0, "ended 0 faults\n")
        assert answers(port, 3)


def test_a_server_is_found_by_its_link_and_by_its_port(link):
    with serving("--robot", "marvin", "--link", link) as server:
        assert str(link) in servers()
        for name in (str(link), server.path, os.path.relpath(link)):
            assert ask(name, {"do": "list"}) == {"faults": []}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_nothing_is_left_of_a_server_however_it_ended(link, number):
    with serving("--robot", "marvin", "--link", link) as server:
        server.end(number)
        until(lambda: not os.path.lexists(link))
        assert str(link) not in servers()
        code, said = fault("list", "--port", link)
        assert code == 1
        assert f"{link}: no server of yours has this port" in said


def test_a_port_that_is_unplugged_fails_as_the_one_in_virtual_time_does(link):
    virtual = FaultBench(XL)
    virtual.have("unplug")
    expected = what_fails(virtual.port, lambda: virtual.port)
    with serving("--robot", "marvin", "--link", link) as server:
        port = opened(link)
        assert answers(port)
        number = add(link, kind="unplug")
        until(lambda: not os.path.lexists(link))
        assert what_fails(port, lambda: PortHandler(str(link))) == expected
        assert None not in expected.values()
        ask(str(link), {"do": "clear", "which": number})
        until(lambda: os.path.lexists(link))
        with suppress(serial.SerialException):
            port.closePort()
        again = opened(link)
        assert answers(again)
        code, said = server.end()
        assert code == 0
        assert "port unplugged\n" in said
        assert "is there again\n" in said
        assert not os.path.lexists(link)


def test_a_server_killed_while_unplugged_or_after_it_leaves_no_link(link):
    with serving("--robot", "marvin", "--link", link) as server:
        add(link, kind="unplug", for_s=0.05)
        until(lambda: not os.path.lexists(link))
        until(lambda: os.path.lexists(link))
        server.end(signal.SIGKILL)
        until(lambda: not os.path.lexists(link))


def test_a_tcp_client_is_hung_up_on_and_may_come_back():
    with serving("--robot", "marvin", "--tcp", "127.0.0.1:0") as server:
        address = ("127.0.0.1", int(server.path.rpartition(":")[2]))
        client = socket.create_connection(address, timeout=10)
        client.sendall(bytes.fromhex("FF FF FD 00 01 03 00 01 19 4E"))
        assert client.recv(100)
        number = add(server.path, kind="unplug")
        assert client.recv(100) == b""
        with socket.create_connection(address, timeout=10) as refused:
            assert refused.recv(100) == b""
        ask(server.path, {"do": "clear", "which": number})
        with socket.create_connection(address, timeout=10) as back:
            back.sendall(bytes.fromhex("FF FF FD 00 01 03 00 01 19 4E"))
            assert back.recv(100)
        client.close()


def test_nonsense_on_the_control_socket_is_answered_or_dropped_and_the_bus_goes_on(link):
    with serving("--robot", "marvin", "--link", link):
        for nonsense in (
            b"\xff\xfe\n",
            b"{}\n",
            b"[1]\n",
            b'{"do": "clear", "which": [1]}\n',
            b"7\n",
        ):
            with socket.socket(socket.AF_UNIX) as asker:
                asker.connect(_address("busemu:", str(link)))
                asker.sendall(nonsense)
                assert "error" in json.loads(asker.makefile().readline())
        silent = [socket.socket(socket.AF_UNIX) for _ in range(20)]
        for asker in silent:
            asker.connect(_address("busemu:", str(link)))
        for asker in silent:  # too many at once, or silent for too long: hung up on
            asker.settimeout(20)
            assert asker.recv(1) == b""
            asker.close()
        assert ask(str(link), {"do": "list"}) == {"faults": []}
        assert answers(opened(link))


def test_a_port_without_server_is_named():
    with pytest.raises(ControlError, match="/dev/pts/9999: no server of yours has this port"):
        ask("/dev/pts/9999", {"do": "list"})


def test_a_wrong_scenario_is_one_line_and_no_server(tmp_path):
    scenario = tmp_path / "faults.toml"
    scenario.write_text('format = "busemu-faults/1"\n[[fault]]\nkind = "dorp"\n', "utf-8")
    command = [sys.executable, "-m", "busemu", "serve", "--robot", "marvin", "--plant", "ideal"]
    done = subprocess.run(
        [*command, "--faults", str(scenario)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith(f"busemu: {scenario}: [[fault]] 1: kind must be one of drop,")
    assert done.stderr.count("\n") == 1
