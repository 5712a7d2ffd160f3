"""`busemu decode`, `busemu monitor` and `busemu serve --trace`, as a person uses them."""

import os
import pty
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from dynamixel_sdk import PacketHandler, PortHandler
from programs import unheard, until
from pty_server import serving
from typer.testing import CliRunner

from busemu.cli import app
from busemu.see import decode, monitor
from busemu.serving import Wanted, opened
from busemu.trace import WireEvent, WireEventKind
from busemu.traffic.follow import read_trace
from busemu.traffic.traceline import Header, Record
from busemu.traffic.wirelog import WireLog

READ = "FF FF FD 00 01 07 00 02 25 00 02 00 2D 95"
ANSWER = "FF FF FD 00 01 06 00 55 00 00 02 C9 5B"
SWAPPED = READ[:-5] + "95 2D"
BUSEMU = [sys.executable, "-m", "busemu"]

app.command("decode")(decode)
app.command("monitor")(monitor)


def busemu(*words, given=None):
    return CliRunner().invoke(app, [str(word) for word in words], input=given)


def test_bytes_in_hex_are_explained_one_field_a_line():
    done = busemu("decode", "--model", "XL-320", *READ.split())
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert lines[0] == "instruction packet, Protocol 2.0: read servo 1: present_position"
    assert "    8  25 00                    address 37: present_position" in lines
    assert lines[-1] == "   12  2D 95                    CRC: right"


def test_a_bad_packet_is_marked_and_gives_exit_code_1():
    done = busemu("decode", SWAPPED)
    assert done.exit_code == 1
    bad = [line for line in done.stdout.splitlines() if line.startswith("!")]
    assert bad == [
        "!  12  95 2D                    CRC: wrong",
        "!     wrong: CRC is 95 2D, these bytes give 2D 95: "
        "its two bytes are swapped, the low one comes first",
    ]


@pytest.mark.parametrize(
    "text",
    [
        READ,
        READ.replace(" ", "").lower(),
        ", ".join("0x" + byte for byte in READ.split()),
        "{" + ",".join("0x" + byte for byte in READ.split()) + "};",
        READ.replace(" ", ":"),
        "".join("\\x" + byte for byte in READ.split()),
        repr(bytes.fromhex(READ)),
        READ.replace(" 01 07", " # the header\n01 07"),
    ],
)
def test_hex_is_understood_as_people_write_it(text, tmp_path):
    (tmp_path / "packet").write_text(text)
    for done in (
        busemu("decode", "--brief", tmp_path / "packet"),
        busemu("decode", "--brief", given=text),
        busemu("decode", "--brief", "-", given=text),
    ):
        assert done.stdout == " > read servo 1: address 37, 2 bytes\n"


def test_raw_bytes_are_understood(tmp_path):
    (tmp_path / "raw").write_bytes(bytes.fromhex(READ + ANSWER))
    done = busemu("decode", "--robot", "marvin", "--brief", tmp_path / "raw")
    assert done.stdout.splitlines() == [
        " > read servo 1: present_position",
        " < servo 1: present_position = 512 (0 rad)",
    ]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["decode", "FF", "FG"], "not hex: 'FG'"),
        (["decode", "FFF"], "not hex: 'FFF'"),
        (["decode", "nowhere.trace"], "there is no file of that name"),
        (["decode", ""], "empty"),
        (["decode", "b'\\xf'"], "not a Python bytes literal"),
        (["decode", "--protocol", "3", "FF"], "--protocol is 1 or 2"),
        (["decode", "--model", "AX-99", "FF"], "AX-12A"),
        (["decode", "--robot", "nobody", "FF"], "no robot named 'nobody': use one of "),
        (["decode", "/tmp"], "/tmp: Is a directory"),
        (["monitor", "/nowhere", "--once"], "/nowhere: No such file"),
        (["monitor", __file__, "--once"], "no trace"),
        (["serve", "--robot", "marvin", "--trace", "/nowhere/t"], "--trace /nowhere/t: No such"),
        (["serve", "--robot", "marvin", "--trace", "t", "--trace-size", "0"], "--trace-size"),
    ],
)
def test_bad_words_get_one_clear_line_and_a_failure(words, says):
    done = busemu(*words)
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("busemu: ")
    assert says in line


# -- a stored trace ------------------------------------------------------------------------------


@pytest.fixture
def trace(tmp_path):
    """Ten reads of servo 1, of which the fourth is not answered, and a bad packet."""
    log = WireLog(tmp_path / "t", Header("marvin", 2.0, 1_000_000, "ideal", 0.0, 1.7e9), 10**6)
    for index in range(10):
        at_s = 1.0 + index * 0.01
        log.heard(b"", at_s - 0.0002)
        kind = WireEventKind.INSTRUCTION
        log.on_wire(WireEvent(kind, at_s, at_s + 0.00014, bytes.fromhex(READ)))
        if index != 3:
            answer = bytes.fromhex(ANSWER)
            log.on_wire(WireEvent(WireEventKind.STATUS, at_s + 0.0006, at_s + 0.00074, answer))
            log.handed(answer, at_s + 0.002)
    log.on_wire(WireEvent(WireEventKind.INSTRUCTION, 2.0, 2.1, bytes.fromhex(SWAPPED)))
    log.close()
    return tmp_path / "t"


def test_a_trace_is_decoded_with_its_times_and_its_own_robot(trace):
    done = busemu("decode", trace)
    assert done.exit_code == 1
    lines = done.stdout.splitlines()
    assert lines[0].startswith("marvin, Protocol 2.0, 1000000 bit/s, timing ideal; ")
    assert lines[2].split(maxsplit=1)[1] == "-0.200  > read servo 1: present_position"
    assert lines[3].split(maxsplit=1)[1] == (
        "+0.460   +1.260  < servo 1: present_position = 512 (0 rad)"
    )
    assert lines[-1] == "20 packets, 1 bad"


def test_of_a_trace_only_what_is_bad_may_be_asked_for(trace):
    lines = busemu("decode", trace, "--bad").stdout.splitlines()
    assert len(lines) == 5
    assert "bytes are swapped" in lines[3]


def test_a_trace_through_a_pipe_and_in_two_halves_is_the_same(trace, tmp_path):
    whole = busemu("decode", trace).stdout
    assert busemu("decode", given=trace.read_bytes()).stdout == whole
    first, *lines = trace.read_text().splitlines(keepends=True)
    (tmp_path / "a").write_text(first + "".join(lines[:9]))
    (tmp_path / "b").write_text(first + "".join(lines[9:]))
    assert busemu("decode", tmp_path / "a", tmp_path / "b").stdout == whole


def test_a_damaged_line_is_passed_over_and_told(trace):
    data = bytearray(trace.read_bytes())
    random.Random(1).shuffle(memoryview(data)[400:460])
    trace.write_bytes(data)
    assert "damaged line" in busemu("decode", trace).stdout.splitlines()[-1]


@pytest.mark.parametrize("own_file", [True, False])
def test_a_trace_of_servos_of_ones_own_names_their_registers(tmp_path, own_file):
    robot, trace = "XL-320:1", tmp_path / "t"
    if own_file:
        robot = str(tmp_path / "mine.toml")
        wiring = '[bus]\nprotocol = 2.0\nbaud_rate = 1000000\nservo_model = "XL-320"\n'
        servo = '[[servo]]\nid = 1\njoint = "a"\n'
        Path(robot).write_text(f'format = "busemu-robot/1"\n{wiring}{servo}', "utf-8")
    with opened([Wanted(robot, trace=trace)]) as (served,):
        bus = served.assemble().bus
        bus.receive(bytes.fromhex(READ), bus.plant_s + 0.01)
        bus.poll(bus.plant_s + 1.0)
    text = busemu("decode", trace).stdout
    assert "read servo 1: present_position" in text
    assert "servo 1: present_position" in busemu("monitor", trace, "--once").stdout


def test_a_reader_that_has_had_enough_gets_no_error(trace):
    command = " ".join([*BUSEMU, "decode", str(trace), str(trace), "| head -1"])
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.stdout.startswith("marvin")
    assert done.stderr == ""


def test_a_snapshot_adds_a_stored_trace_up(trace):
    done = busemu("monitor", trace, "--once", "--packets", 2)
    assert done.exit_code == 0
    text = done.stdout
    assert "\x1b" not in text
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert lines[0].startswith(
        "marvin 10 instructions/s 11 in 2 s 1 bad 0 with error 1 unanswered 0"
    )
    assert "read 10.0 11" in lines
    assert "1 9.0 9 0 1" in lines
    assert "wrong CRC 1" in lines
    assert "37 < present_position 512 (0 rad) 1.0" in lines
    assert any(
        line.endswith("median 0.74, 95 % below 0.74 median 2.20, 95 % below 2.20") for line in lines
    )
    assert "wrong: CRC is 95 2D" in lines[-1]


def test_a_snapshot_shows_the_servo_asked_for(trace):
    text = busemu("monitor", trace, "--once", "--servo", "7").stdout
    assert "registers of servo 7" in text
    assert "37" not in text.split("registers of servo 7")[1].split("from instruction")[0]


def test_a_snapshot_of_a_trace_with_nothing_in_it_is_no_error(tmp_path):
    path = tmp_path / "t"
    path.write_text(Header("no such robot", 1.0).line())
    assert "no answers yet" in busemu("monitor", path, "--once").stdout


# -- a server that writes one --------------------------------------------------------------------


def reads(path, count):
    """Read so many positions of servo 1 through the official SDK; how often it had to ask.

    A busy machine may be late for the SDK, which then asks again.
    """
    port, packets = PortHandler(path), PacketHandler(2.0)
    assert port.openPort()
    assert port.setBaudRate(1_000_000)
    results = []
    while results.count(0) < count:
        results.append(packets.read2ByteTxRx(port, 1, 37)[1])
        assert len(results) < 10 * count
    port.closePort()
    return len(results)


@pytest.mark.pty
def test_a_server_killed_leaves_whole_lines_and_the_next_goes_on(tmp_path):
    path, asked = tmp_path / "t", 0
    for start in (1, 2):
        with serving("--robot", "marvin", "--trace", path) as server:
            asked += reads(server.path, 40)
            server.end(signal.SIGKILL)
        entries = list(read_trace(path))
        assert None not in entries
        assert path.read_bytes().endswith(b"\n")
        assert len([each for each in entries if isinstance(each, Header)]) == start
        found = [each for each in entries if isinstance(each, Record)]
        assert 2 * asked - 2 * start <= len(found) <= 2 * asked
    read_s = [r.read_s for r in found if r.event.kind is WireEventKind.INSTRUCTION]
    assert read_s == sorted(read_s)
    assert all(r.event.start_s < r.event.end_s for r in found)
    assert all(r.event.end_s < r.handed_s for r in found if r.read_s is None)


@pytest.mark.pty
def test_a_server_that_ends_writes_all_and_keeps_to_the_size(tmp_path):
    path = tmp_path / "t"
    with serving(
        "--robot", "marvin", "--timing", "ideal", "--trace", path, "--trace-size", 0.07
    ) as server:
        reads(server.path, 250)
        time.sleep(0.1)  # the client has the last reply a little before the server has told of it
        assert server.end()[0] == 0
    assert path.stat().st_size + (tmp_path / "t.1").stat().st_size <= 70_000
    last = list(read_trace(path))[-1]
    assert last.event.kind is WireEventKind.STATUS
    assert last.handed_s is not None


@pytest.mark.pty
def test_the_live_view_follows_a_server_that_is_killed_and_starts_again(tmp_path):
    path = tmp_path / "t"
    master, slave = pty.openpty()
    os.set_blocking(master, False)
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "140", "LINES": "40"}
    command = [*unheard("INT"), *BUSEMU, "monitor", str(path)]  # as a shell's background jobs
    shown = ""

    def shows(words):
        def look():
            nonlocal shown
            try:
                shown += os.read(master, 1 << 20).decode("utf-8", "replace")
            except BlockingIOError:
                time.sleep(0.05)
            return words in shown

        return look

    view = subprocess.Popen(command, stdout=slave, stderr=subprocess.PIPE, env=environment)
    try:
        until(shows("waiting for a trace"))
        for said in ("read servo 1: present_position", "the server has started again"):
            with serving("--robot", "marvin", "--trace", path) as server:
                reads(server.path, 10)
                until(shows(said))
                server.end(signal.SIGKILL)
        view.send_signal(signal.SIGINT)
        until(lambda: shows("")() and view.poll() is not None)  # a terminal goes on reading
        assert view.returncode == 0
        assert view.stderr.read() == b""
    finally:
        view.kill()
        view.wait()
        view.stderr.close()
        os.close(master)
        os.close(slave)
