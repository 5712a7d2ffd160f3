"""`busemu serve` on a real pseudo-terminal: foreign clients, rude clients, links and endings."""

from __future__ import annotations

import fcntl
import os
import random
import signal
import subprocess
import sys
import termios
import time
import tomllib
import tty
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
import serial
from dynamixel_sdk import GroupSyncRead, GroupSyncWrite
from programs import sdk, unheard, until
from pty_server import Server, processes_with, serving
from pypot.dynamixel.io import Dxl320IO, DxlIO

pytestmark = pytest.mark.pty

IDS = list(range(1, 19))
OK, TIMEOUT = 0, -3001
NAMES = ("phantomx", "marvin")
HEXAPODS = pytest.mark.parametrize("name", NAMES)


@pytest.fixture(scope="module")
def servers() -> Iterator[dict[str, Server]]:
    """One server a robot, shared by all tests whose clients leave the servos as they were."""
    with serving("--robot", "phantomx") as one, serving("--robot", "marvin") as two:
        yield {"phantomx": one, "marvin": two}


def protocol_of(name: str) -> float:
    return NAMES.index(name) + 1.0


def patiently(attempt: Callable[[], int]) -> int:
    """The result of an exchange; a busy machine may cost a few of them their timeout."""
    for _ in range(5):
        result = attempt()
        if result == OK:
            break
    return result


def assert_served(path: str, name: str) -> None:
    """A newly come client is served, at the latest when the wire has carried what others left."""
    with sdk(path, protocol_of(name)) as (port, packets):

        def answered() -> bool:
            try:
                return packets.ping(port, 1)[1] == OK
            except IndexError:  # the SDK's own, at a status that answers somebody else's ping
                return False

        until(answered)
        until(lambda: packets.write1ByteTxRx(port, 1, 25, 0) == (OK, 0))


# -- clients ------------------------------------------------------------------------------------


@HEXAPODS
def test_official_sdk_pings_reads_and_writes(servers: dict[str, Server], name: str) -> None:
    present = 36 if name == "phantomx" else 37
    with sdk(servers[name].path, protocol_of(name)) as (port, packets):
        assert packets.ping(port, 1) == (12 if name == "phantomx" else 350, OK, 0)
        position, result, error = packets.read2ByteTxRx(port, 1, present)
        assert (result, error) == (OK, 0)
        assert 0 <= position <= 1023
        assert packets.write2ByteTxRx(port, 1, 30, 600) == (OK, 0)
        assert packets.read2ByteTxRx(port, 1, 30) == (600, OK, 0)
        assert packets.ping(port, 99)[1] == TIMEOUT


@HEXAPODS
def test_official_sdk_moves_all_18_by_sync_write(servers: dict[str, Server], name: str) -> None:
    present = 36 if name == "phantomx" else 37
    with sdk(servers[name].path, protocol_of(name)) as (port, packets):
        for address, data in ((30, [0x08, 2]), (24, [1])):
            group = GroupSyncWrite(port, packets, address, len(data))
            for i in IDS:
                assert group.addParam(i, data)
            assert group.txPacket() == OK
        until(lambda: packets.read2ByteTxRx(port, 18, present)[0] == 0x208)
        if name == "marvin":
            read = GroupSyncRead(port, packets, present, 2)
            for i in IDS:
                read.addParam(i)
            assert patiently(read.txRxPacket) == OK
            assert {read.getData(i, present, 2) for i in IDS} == {0x208}
            assert patiently(lambda: packets.broadcastPing(port)[1]) == OK


@HEXAPODS
def test_pypot_finds_reads_and_moves_the_servos(servers: dict[str, Server], name: str) -> None:
    make = DxlIO if name == "phantomx" else Dxl320IO
    with closing(make(servers[name].path, baudrate=1_000_000, timeout=0.2)) as io:
        assert io.scan(range(15, 22)) == [15, 16, 17, 18]
        assert set(io.get_model(IDS)) == {"AX-12" if name == "phantomx" else "XL-320"}
        # pypot flushes its output before it sends, and a pty throws away what its kernel had no
        # time to pass on yet; a driver of a real adapter does not. So a write may need repeating.
        goals = {i: float(3 * i - 30) for i in IDS}
        until(lambda: (io.enable_torque(IDS), all(io.is_torque_enabled(IDS)))[1])
        until(lambda: (io.set_goal_position(goals), near(io.get_goal_position(IDS), goals))[1])
        until(lambda: near(io.get_present_position(IDS), goals))
        until(lambda: (io.disable_torque(IDS), not any(io.is_torque_enabled(IDS)))[1])


def near(seen_deg: tuple[float, ...], goals_deg: dict[int, float]) -> bool:
    return list(seen_deg) == pytest.approx(list(goals_deg.values()), abs=0.3)


def test_pypot_sync_reads_an_xl320(servers: dict[str, Server]) -> None:
    path = servers["marvin"].path
    with closing(Dxl320IO(path, timeout=0.2, use_sync_read=True)) as io:
        assert io.get_return_delay_time(IDS) == tuple([500] * 18)
        assert len(io.get_present_position(IDS)) == 18
        assert io.get_present_voltage([1, 2]) == pytest.approx((7.4, 7.4))


def test_rustypot_reads_and_writes_xl320(servers: dict[str, Server]) -> None:
    rustypot = pytest.importorskip("rustypot")
    controller = rustypot.Xl320PyController(servers["marvin"].path, 1_000_000, 0.2)
    assert controller.ping(3)
    assert controller.broadcast_scan() == dict.fromkeys(IDS, 350)
    assert len(controller.sync_read_present_position(IDS)) == 18
    controller.sync_write_goal_position(IDS, [600 + i for i in IDS])
    assert controller.sync_read_goal_position(IDS) == [600 + i for i in IDS]
    controller.close()
    assert_served(servers["marvin"].path, "marvin")


def test_rustypot_reads_and_writes_ax(servers: dict[str, Server]) -> None:
    rustypot = pytest.importorskip("rustypot")
    controller = rustypot.AxPyController(servers["phantomx"].path, 1_000_000, 0.2)
    assert controller.ping(3)
    assert controller.read_model_number(3) == [12]
    goals_rad = [0.02 * i for i in IDS]
    controller.sync_write_goal_position(IDS, goals_rad)
    seen_rad = [controller.read_goal_position(i)[0] for i in IDS]
    assert seen_rad == pytest.approx(goals_rad, abs=0.01)
    controller.close()
    assert_served(servers["phantomx"].path, "phantomx")


def test_port_can_be_opened_by_pyserial_at_any_baud_rate(servers: dict[str, Server]) -> None:
    for baud_rate in (9600, 57_600, 1_000_000, 3_000_000, 123_456):
        with serial.Serial(servers["marvin"].path, baud_rate, timeout=0.05):
            pass
    assert_served(servers["marvin"].path, "marvin")


# -- clients without manners --------------------------------------------------------------------


@contextmanager
def raw(path: str) -> Iterator[int]:
    descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


@HEXAPODS
def test_client_that_vanishes_mid_packet_does_not_harm_the_next(
    servers: dict[str, Server], name: str
) -> None:
    for cut in (1, 4, 7):
        with raw(servers[name].path) as descriptor:
            os.write(descriptor, b"\xff\xff\xfd\x00\x01\x03\x00\x01"[:cut])
        assert_served(servers[name].path, name)


@HEXAPODS
def test_client_killed_while_it_reads_does_not_harm_the_next(
    servers: dict[str, Server], name: str
) -> None:
    program = (
        "import dynamixel_sdk as d, sys\n"
        "p = d.PortHandler(sys.argv[1]); p.baudrate = 1000000; p.openPort()\n"
        "h = d.PacketHandler(float(sys.argv[2]))\n"
        "h.ping(p, 1); print('going', flush=True)\n"
        "while True: h.read2ByteTxRx(p, 1, 30)\n"
    )
    client = subprocess.Popen(
        [sys.executable, "-c", program, servers[name].path, str(protocol_of(name))],
        stdout=subprocess.PIPE,
    )
    assert client.stdout.readline() == b"going\n"
    client.kill()
    client.communicate()
    assert_served(servers[name].path, name)


@HEXAPODS
def test_client_at_a_wrong_baud_rate_meets_silence_and_does_not_harm_the_next(
    servers: dict[str, Server], name: str
) -> None:
    for baud_rate in (57_600, 115_200, 2_000_000):
        with sdk(servers[name].path, protocol_of(name), baud_rate) as (port, packets):
            assert packets.ping(port, 1)[1] == TIMEOUT
        assert_served(servers[name].path, name)


@HEXAPODS
def test_port_left_exclusive_is_open_to_the_next(name: str) -> None:
    """As root the kernel lets everybody in, so the flag itself is looked at."""
    tiocgexcl = 0x80045440
    with serving("--robot", name) as server:
        with raw(server.path) as descriptor:
            fcntl.ioctl(descriptor, termios.TIOCEXCL)
        with raw(server.path) as descriptor:
            until(
                lambda: (
                    not int.from_bytes(fcntl.ioctl(descriptor, tiocgexcl, bytes(4)), sys.byteorder)
                )
            )
        assert_served(server.path, name)


@HEXAPODS
def test_random_bytes_do_not_harm_the_next_client(servers: dict[str, Server], name: str) -> None:
    chance = random.Random(7)
    with raw(servers[name].path) as descriptor:
        for _ in range(20):
            os.write(descriptor, chance.randbytes(1000))
    assert_served(servers[name].path, name)


@HEXAPODS
def test_flood_is_held_up_at_the_port_and_forgotten_with_its_sender(name: str) -> None:
    """The port takes no more than the wire can carry, so a client that left leaves little."""
    program = (
        "import os, sys\n"
        "port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)\n"
        "while True: print(os.write(port, bytes(range(256)) * 64), flush=True)\n"
    )
    with serving("--robot", name) as server:
        tame(server.path)
        flood = subprocess.Popen(
            [sys.executable, "-c", program, server.path], stdout=subprocess.PIPE
        )
        begun_s = time.monotonic()
        for _ in range(6):
            assert flood.stdout.readline()
        # 96 KiB are 0.98 s of the wire; the kernel and one read may hold some of it.
        assert time.monotonic() - begun_s > 0.6
        assert server.process.poll() is None
        flood.kill()
        flood.communicate()
        assert_served(server.path, name)
        resident = int(
            Path(f"/proc/{server.process.pid}/statm").read_text("utf-8").split()[1]
        ) * os.sysconf("SC_PAGE_SIZE")
        assert resident < 400e6


def tame(path: str) -> None:
    """Put the line at 1 Mbps, without which a flood lasts."""
    with serial.Serial(path, 1_000_000):
        pass


@HEXAPODS
def test_client_that_never_reads_does_not_stop_the_bus(name: str) -> None:
    ping = (
        b"\xff\xff\x01\x02\x01\xfb"
        if name == "phantomx"
        else b"\xff\xff\xfd\x00\x01\x03\x00\x01\x19\x4e"
    )
    with serving("--robot", name) as server:
        with serial.Serial(server.path, 1_000_000) as port:
            for _ in range(1500):
                port.write(ping)
            port.flush()
        assert_served(server.path, name)


def test_terminal_settings_a_client_leaves_do_not_harm_the_next(
    servers: dict[str, Server],
) -> None:
    path = servers["marvin"].path
    with raw(path) as descriptor:
        cooked = termios.tcgetattr(descriptor)
        cooked[0] |= termios.ICRNL | termios.IXON
        cooked[1] |= termios.OPOST | termios.ONLCR
        cooked[3] |= termios.ICANON | termios.ECHO | termios.ISIG
        termios.tcsetattr(descriptor, termios.TCSANOW, cooked)
        os.write(descriptor, b"hello\n\x03")
    assert_served(path, "marvin")
    with raw(path) as descriptor:
        tty.setraw(descriptor)


# -- link, endings, errors ----------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_link_leads_to_the_port_and_goes_with_the_server(tmp_path: Path, number: int) -> None:
    link = tmp_path / f"servos-{number}"
    with serving("--robot", "marvin", "--link", link) as server:
        assert str(link.readlink()) == server.path
        assert_served(str(link), "marvin")
        code, said = server.end(number)
        assert code == (-number if number == signal.SIGKILL else 0)
        assert "Traceback" not in said
        until(lambda: not link.is_symlink())
        until(lambda: not processes_with(str(link)))


def test_a_server_outlives_its_terminal_where_nohup_asks_for_that() -> None:
    with serving("--robot", "marvin", through=unheard("INT HUP")) as server:
        server.process.send_signal(signal.SIGHUP)
        assert_served(server.path, "marvin")
        code, said = server.end(signal.SIGINT)  # which background jobs have ignored, too
        assert (code, "Traceback" in said) == (0, False)


def test_link_of_a_killed_process_group_goes_too(tmp_path: Path) -> None:
    link = tmp_path / "servos"
    with serving("--robot", "marvin", "--link", link) as server:
        os.killpg(server.process.pid, signal.SIGKILL)
        server.process.communicate()
        until(lambda: not link.is_symlink())
        until(lambda: not processes_with(str(link)))


def refused(*arguments: object) -> str:
    """The one line of a command that is refused."""
    ran = subprocess.run(
        [sys.executable, "-m", "busemu", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ran.returncode not in (0, None)
    assert "Traceback" not in ran.stderr
    assert ran.stdout == ""
    (line,) = ran.stderr.splitlines()
    assert line.startswith("busemu: ")
    return line


def test_link_in_use_is_refused_and_left_alone(tmp_path: Path) -> None:
    link = tmp_path / "servos"
    with serving("--robot", "marvin", "--link", link) as server:
        line = refused("serve", "--robot", "marvin", "--plant", "ideal", "--link", link)
        assert str(link) in line
        assert "in use" in line
        assert str(link.readlink()) == server.path
        assert_served(str(link), "marvin")


def test_file_in_the_place_of_a_link_is_refused_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "thesis.txt"
    path.write_text("chapter 1", "utf-8")
    line = refused("serve", "--robot", "marvin", "--plant", "ideal", "--link", path)
    assert str(path) in line
    assert path.read_text("utf-8") == "chapter 1"


def test_link_in_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    line = refused("serve", "--robot", "marvin", "--plant", "ideal", "--link", tmp_path / "a" / "b")
    assert "no folder" in line


def test_stale_link_is_replaced(tmp_path: Path) -> None:
    link = tmp_path / "servos"
    link.symlink_to("/dev/pts/no-such-port")
    with serving("--robot", "marvin", "--link", link) as server:
        assert str(link.readlink()) == server.path


def test_link_that_someone_else_has_put_there_since_is_left_alone(tmp_path: Path) -> None:
    link = tmp_path / "servos"
    with serving("--robot", "marvin", "--link", link) as server:
        link.unlink()
        link.symlink_to("/dev/null")
        server.end()
        until(lambda: not processes_with(str(link)))
    assert str(link.readlink()) == "/dev/null"


def test_two_servers_stand_side_by_side(servers: dict[str, Server]) -> None:
    assert servers["phantomx"].path != servers["marvin"].path
    with (
        sdk(servers["phantomx"].path, 1.0) as (port1, packets1),
        sdk(servers["marvin"].path, 2.0) as (port2, packets2),
    ):
        for _ in range(20):
            assert patiently(lambda: packets1.ping(port1, 1)[1]) == OK
            assert patiently(lambda: packets2.ping(port2, 1)[1]) == OK


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--robot", "r2d2"], ["r2d2", "marvin", "phantomx"]),
        (["--robot", "/no/such.toml"], ["/no/such.toml", "cannot be read"]),
        (["--robot", "marvin", "--timing", "fast"], ["fast", "thesis-marvin"]),
        (["--robot", "marvin", "--timing", "/no/such.toml"], ["/no/such.toml"]),
        (["--robot", "marvin", "--plant", "gazebo"], ["gazebo", "ideal", "bullet"]),
        (["--robot", "marvin", "--plant", "ideal", "--observe", "seen.txt"], ["seen.txt", ".csv"]),
        (
            ["--robot", "marvin", "--plant", "ideal", "--observe", "/no/seen.csv"],
            ["/no/seen.csv", "No such file"],
        ),
    ],
)
def test_mistake_on_the_command_line_is_one_clear_line(
    arguments: list[str], parts: list[str]
) -> None:
    line = refused("serve", *arguments)
    for part in parts:
        assert part in line


def test_mistake_in_a_robot_file_is_one_clear_line(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'format = "busemu-robot/1"\n[bus]\nprotocol = 1.0\nbaud_rate = 1000000\n'
        'servo_model = "AX-99"\n[[servo]]\nid = 1\njoint = "a"\n',
        "utf-8",
    )
    line = refused("serve", "--robot", path, "--plant", "ideal")
    assert "mine.toml" in line
    assert "AX-99" in line


# -- observation --------------------------------------------------------------------------------


def test_observation_is_whole_after_an_end_by_signal(tmp_path: Path) -> None:
    pytest.importorskip("sim.world")
    path = tmp_path / "seen.csv"
    for number in (signal.SIGINT, signal.SIGTERM):
        with serving("--robot", "marvin", "--observe", path, plant="bullet") as server:
            assert not path.exists()
            assert_served(server.path, "marvin")
            time.sleep(0.5)
            assert server.end(number)[0] == 0
        head, *rows = path.read_text("utf-8").splitlines()
        assert head == "t_s,t_reply_s,servo_id,op,register,raw"
        instants = sorted({float(row.split(",")[0]) for row in rows})
        assert len(instants) > 1
        assert all(len(row.split(",")) == 6 for row in rows)
        assert path.read_text("utf-8").endswith("\n")
        assert tomllib.loads(path.with_suffix(".toml").read_text("utf-8"))["robot"] == "marvin"
        assert {p.name for p in tmp_path.iterdir()} == {"seen.csv", "seen.toml"}
        path.unlink()


def test_observation_of_a_killed_server_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "seen.csv"
    with serving("--robot", "marvin", "--observe", path) as server:
        assert_served(server.path, "marvin")
        server.end(signal.SIGKILL)
    assert list(tmp_path.iterdir()) == []
