"""Several buses in one server, and adapters that hear themselves."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from dynamixel_sdk import GroupSyncRead, PacketHandler, PortHandler
from programs import until
from pty_server import serving
from typer.testing import CliRunner
from virtual_bus import AX, XL, Bench

from busemu.cli import app
from busemu.serve import ServerState
from busemu.serving import Served, ServingError, Teller, Wanted, each, opened
from busemu.tables import load_robot
from busemu.timing import load_profile

BOTH = pytest.mark.parametrize("model", [AX, XL])


def open_port(path: object) -> PortHandler:
    port = PortHandler(str(path))
    assert port.setBaudRate(1_000_000)
    return port


@pytest.mark.pty
def test_each_robot_has_its_own_port_servos_and_trace(tmp_path: Path) -> None:
    marvin, phantomx = tmp_path / "a", tmp_path / "b"
    arguments = ("--robot", "marvin", "--link", marvin, "--robot", "phantomx", "--link", phantomx)
    traces = ("--trace", tmp_path / "a.trace", "--trace", "-")
    with serving(*arguments, "--timing", "ideal", *traces) as server:
        one, two = open_port(marvin), open_port(phantomx)
        first, second = PacketHandler(2.0), PacketHandler(1.0)
        for turn in range(20):
            goals = 500 + turn, 600 + turn  # until: a busy machine may be late for the SDK
            until(lambda g=goals: first.write2ByteTxRx(one, 3, 30, g[0]) == (0, 0))
            until(lambda g=goals: second.write2ByteTxRx(two, 3, 30, g[1]) == (0, 0))
            until(lambda g=goals: first.read2ByteTxRx(one, 3, 30) == (g[0], 0, 0))
            until(lambda g=goals: second.read2ByteTxRx(two, 3, 30) == (g[1], 0, 0))
        group = GroupSyncRead(one, first, 37, 2)
        for servo_id in range(1, 19):
            group.addParam(servo_id)
        until(lambda: group.txRxPacket() == 0)
        assert first.ping(two, 1)[1] != 0
        one.closePort()
        two.closePort()
        code, said = server.end()
    assert code == 0, said
    assert "Traceback" not in said
    assert len(re.findall("^port /dev/pts/", server.said + said, re.MULTILINE)) == 2
    assert not marvin.exists()
    assert not phantomx.exists()
    assert '"robot":"marvin"' in (tmp_path / "a.trace").read_text("utf-8")
    assert {found.name for found in tmp_path.iterdir()} == {"a.trace"}


def test_an_option_belongs_to_the_robot_in_its_place() -> None:
    assert each("--link", ["/a", "/b"], 2) == ["/a", "/b"]
    assert each("--link", ["-", "/b"], 2) == ["", "/b"]
    assert each("--link", None, 3) == ["", "", ""]
    assert each("--timing", ["ideal"], 3, shared=True) == ["ideal"] * 3


@pytest.mark.parametrize(("count", "shared"), [(2, False), (3, True)])
def test_an_option_given_too_seldom_or_too_often_is_refused(count: int, shared: bool) -> None:
    values = ["x"] * (count - 1 if count == 2 else 2)
    with pytest.raises(ServingError, match="give it once a robot, in the same order"):
        each("--link", values, count, shared=shared)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--link", "/tmp/a"], "--link is given 1 time and --robot 2 times"),
        (["--timing", "ideal"] * 3, "--timing is given 3 times"),
        (["--plant", "rubber"], "no plant named 'rubber'"),
        (["--echo", "--device", "/dev/a", "--device", "/dev/b"], "--echo is for a virtual port"),
    ],
)
def test_what_cannot_be_served_is_said_in_one_line(arguments: list[str], said: str) -> None:
    result = CliRunner().invoke(
        app, ["serve", "--robot", "marvin", "--robot", "phantomx", *arguments]
    )
    assert result.exit_code == 1
    assert result.output.startswith("busemu: ")
    assert said in result.output
    assert result.output.count("\n") == 1


# -- echo ---------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("profile", ["ideal", "instant", "ftdi-1ms"])
def test_an_adapter_that_hears_itself_gives_the_host_its_bytes_before_the_reply(
    model: str, profile: str
) -> None:
    bench = Bench(model, profile=replace(load_profile(profile), echo=True))
    plain = Bench(model, profile=profile)
    request = bench.packet(1)
    reply = plain.send(request)
    assert reply
    assert bench.send(request) == request + reply
    noise = b"\x00\x01\x02"
    assert bench.send(noise) == noise


@BOTH
def test_an_echo_is_over_when_the_last_bit_is_on_the_wire(model: str) -> None:
    bench = Bench(model, profile=replace(load_profile("ideal"), echo=True))
    request = bench.packet(1)
    bench.bus.receive(request, 0.0)
    over_s = len(request) * 1e-5
    assert bench.bus.poll(over_s - 1e-6) == b""
    assert bench.bus.poll(over_s + 1e-6) == request


def test_servos_that_hang_on_nothing_are_served_without_an_engine() -> None:
    with opened([Wanted("XM430-W350:1,2"), Wanted("AX-12A:1")]) as buses:
        for one in buses:
            one.assemble()
            said = "\n".join(one.describe())
            assert "plant ideal" in said
            assert f"busemu timing --robot {one.wanted.robot} --port {one.port.path}" in said
    with pytest.raises(ServingError, match=r"AX-12A:1 names servos and no bodies.*leave --plant"):
        Served(Wanted("AX-12A:1", plant="bullet"))
    assert Wanted("marvin").plant is None
    with opened([Wanted("marvin", timing="instant")]) as (marvin,):
        assert marvin.plant == "bullet"


def test_physics_that_an_ideal_plant_leaves_out_is_told(tmp_path: Path) -> None:
    shipped = load_robot("pendulum").path.read_text("utf-8")
    more = tmp_path / "worn.toml"
    more.write_text(shipped + '\n[[effect]]\nname = "backlash"\n', "utf-8")
    with opened([Wanted(str(more), plant="ideal"), Wanted("marvin", plant="ideal")]) as buses:
        for one in buses:
            one.assemble()
        worn, plain = ("\n".join(one.describe()) for one in buses)
    count = len(load_robot(more).document["effect"])
    assert f"{count} effect" in worn
    assert "of worn.toml left out: the ideal plant has no physics" in worn
    assert "left out" not in plain


def test_what_is_noticed_of_a_served_robot_is_told_once(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    world = tmp_path / "pushed.toml"
    world.write_text(
        'format = "busemu-world/1"\n[[push]]\nat_s = 0.1\nfor_s = 0.5\n'
        "force_n = [40.0, 0.0, 20.0]\nat_m = [0.0, 0.0, 0.05]\n",
        "utf-8",
    )
    with opened([Wanted("marvin", world=world)]) as buses:
        (served,) = buses
        station = served.assemble()
        tell = Teller(buses)
        tell(ServerState())
        assert "noticed" not in capfd.readouterr().out
        for servo in served.bus.servos:
            servo.write(24, b"\x01")  # torque on
        station.bus.advance_plant(station.bus.plant_s + 1.0)
        tell(ServerState())
        said = capfd.readouterr().out
        assert re.search(r"^marvin: noticed at 0\.\d\d s: fall: trunk, leans by", said, re.M)
        tell(ServerState())
        assert "noticed" not in capfd.readouterr().out
