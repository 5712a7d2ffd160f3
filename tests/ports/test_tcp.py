"""A bus over TCP: one client after the other, none of whom can harm the next."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import dynamixel_sdk
import pytest
import serial
from port_programs import IDS, OK, meets, refused, serving
from programs import PATIENCE_S, until

from busemu.ports.tcp import TcpError, TcpPort


class SocketPort(dynamixel_sdk.PortHandler):
    """The SDK's port on a URL of pyserial's: only the opening is another."""

    def setupPort(self, cflag_baud: int) -> bool:  # noqa: N802
        self.ser = serial.serial_for_url(self.port_name, timeout=0)
        self.is_open = True
        self.tx_time_per_byte = 10_000.0 / self.baudrate
        return True


@pytest.fixture
def port() -> Iterator[TcpPort]:
    with closing(TcpPort("127.0.0.1:0")) as made:
        yield made


def connected(port: TcpPort) -> socket.socket:
    place = port.path.removeprefix("socket://").rpartition(":")
    return socket.create_connection((place[0], int(place[2])), timeout=PATIENCE_S)


def heard(port: TcpPort, size: int) -> bytes:
    data = b""
    while len(data) < size:
        assert port.wait(PATIENCE_S)
        data += port.read()
    return data


def test_bytes_pass_as_they_are_in_both_directions(port: TcpPort) -> None:
    everything = bytes(range(256))
    with connected(port) as client:
        assert not port.wait(0.0)
        client.sendall(everything)
        assert heard(port, 256) == everything
        port.write(everything)
        assert client.recv(1000) == everything
        assert port.baud_rate() == 0


def test_without_a_client_there_is_nothing_to_read_and_replies_are_lost(port: TcpPort) -> None:
    assert not port.wait(0.0)
    assert port.read() == b""
    port.write(b"lost")
    with connected(port) as client:
        client.sendall(b"a")
        assert heard(port, 1) == b"a"
        port.write(b"b")
        assert client.recv(10) == b"b"


def test_second_client_is_served_when_the_first_has_left(port: TcpPort) -> None:
    with connected(port) as first:
        first.sendall(b"1")
        assert heard(port, 1) == b"1"
        with connected(port) as second:
            second.sendall(b"2")
            assert not port.wait(0.05)
            first.close()
            assert heard(port, 1) == b"2"
            port.write(b"reply")
            assert second.recv(10) == b"reply"


def test_client_that_resets_the_connection_does_not_harm_the_next(port: TcpPort) -> None:
    client = connected(port)
    client.sendall(b"x")
    assert heard(port, 1) == b"x"
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
    client.close()
    for _ in range(3):
        port.write(b"reply")
    with connected(port) as second:
        second.sendall(b"y")
        assert heard(port, 1) == b"y"


def test_client_that_never_reads_stops_nobody(port: TcpPort) -> None:
    with connected(port) as client:
        client.sendall(b"x")
        assert heard(port, 1) == b"x"
        for _ in range(200):
            port.write(bytes(65536))
    assert port.wait(PATIENCE_S)
    assert port.read() == b""


@pytest.mark.parametrize("address", ["4000", ":4000", "localhost", "localhost:http", "a:70000"])
def test_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(TcpError, match="HOST:PORT"):
        TcpPort(address)


def test_ipv6_address_is_written_in_brackets() -> None:
    try:
        port = TcpPort("[::1]:0")
    except TcpError:
        pytest.skip("this machine has no IPv6")
    with closing(port):
        assert port.path.startswith("socket://[::1]:")


def use(port: Any, protocol: float) -> None:
    """Do with the SDK what a program does, and leave."""
    assert port.setBaudRate(1_000_000)
    packets = dynamixel_sdk.PacketHandler(protocol)
    assert meets(OK, lambda: packets.ping(port, 1)[1])
    assert meets((OK, 0), lambda: packets.write2ByteTxRx(port, 3, 30, 600))
    assert meets((600, OK, 0), lambda: packets.read2ByteTxRx(port, 3, 30))
    if protocol == 2.0:
        read = dynamixel_sdk.GroupSyncRead(port, packets, 37, 2)
        for servo_id in IDS:
            read.addParam(servo_id)
        assert meets(OK, read.txRxPacket)
    port.closePort()


@pytest.mark.parametrize("name", ["phantomx", "marvin"])
def test_sdk_over_a_socket_reads_and_writes_one_client_after_the_other(name: str) -> None:
    protocol = 1.0 if name == "phantomx" else 2.0
    with serving("--robot", name, "--tcp", "127.0.0.1:0") as server:
        assert server.path.startswith("socket://127.0.0.1:")
        for _ in range(2):
            use(SocketPort(server.path), protocol)
        code, said = server.end()
        assert code == 0, said


def test_client_that_vanishes_mid_packet_does_not_harm_the_next() -> None:
    ping = b"\xff\xff\xfd\x00\x01\x03\x00\x01\x19\x4e"
    with serving("--robot", "marvin", "--tcp", "127.0.0.1:0") as server:
        number = int(server.path.rpartition(":")[2])
        for cut in (1, 4, 7):
            with socket.create_connection(("127.0.0.1", number)) as client:
                client.sendall(ping[:cut])
            with socket.create_connection(("127.0.0.1", number), timeout=1.0) as client:

                def answered(client: socket.socket = client) -> bool:
                    client.sendall(ping)
                    return client.recv(100).startswith(b"\xff\xff\xfd\x00\x01\x07\x00\x55")

                until(answered)


def test_mistakes_are_one_clear_line(port: TcpPort) -> None:
    serve = ("serve", "--robot", "marvin", "--plant", "ideal")
    address = port.path.removeprefix("socket://")
    line = refused(*serve, "--tcp", address)
    assert address in line
    assert "choose another port" in line
    assert "HOST:PORT" in refused(*serve, "--tcp", "4000")
    assert "no such host" in refused(*serve, "--tcp", "no-such-host.invalid:4000")
    assert "exclude each other" in refused(*serve, "--tcp", "127.0.0.1:0", "--link", "/tmp/x")
