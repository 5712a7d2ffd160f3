"""The pytest plugin, as a user's own test suite meets it."""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from bench.testing import ServoBusError, ServoBusMaker
from busemu.plant import Plant
from busemu.tables import Robot

pytest_plugins = ["pytester"]

#: A robot's own code, as a user would have it, and the test of it.
ARM = """
    from dynamixel_sdk import COMM_SUCCESS, PacketHandler

    def go_to(port, servo_id, count):
        packets = PacketHandler(2.0)
        assert packets.write1ByteTxRx(port, servo_id, 24, 1) == (COMM_SUCCESS, 0)
        assert packets.write2ByteTxRx(port, servo_id, GOAL, count) == (COMM_SUCCESS, 0)
"""
TEST = """
    import pytest
    from arm import go_to

    def test_a_servo_goes_where_it_is_told(servo_bus):
        bus = servo_bus("marvin")
        go_to(bus.port, 3, 600)
        bus.run(1.0)
        assert bus.servo(3).register("present_position") == pytest.approx(600, abs=2)
"""


@pytest.fixture(autouse=True)
def _clean(pytester: pytest.Pytester) -> None:
    pytester.makeini("[pytest]\naddopts = --strict-markers\nfilterwarnings = error")


def arm(pytester: pytest.Pytester, goal_address: int = 30) -> None:
    pytester.makepyfile(arm=ARM.replace("GOAL", str(goal_address)))


def test_five_lines_test_a_robots_own_code(pytester: pytest.Pytester) -> None:
    arm(pytester)
    pytester.makepyfile(TEST)
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_the_same_test_fails_where_the_code_is_wrong(pytester: pytest.Pytester) -> None:
    arm(pytester, goal_address=32)  # moving speed
    pytester.makepyfile(TEST)
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["E  *assert 512 == 600*"])


@pytest.mark.pty
def test_the_same_test_runs_over_a_pty_when_asked(pytester: pytest.Pytester) -> None:
    arm(pytester)
    pytester.makepyfile(TEST)
    pytester.runpytest_subprocess("--busemu-wall").assert_outcomes(passed=1)


@pytest.mark.pty
def test_the_same_test_fails_over_a_pty_too(pytester: pytest.Pytester) -> None:
    arm(pytester, goal_address=32)
    pytester.makepyfile(TEST)
    result = pytester.runpytest_subprocess("--busemu-wall")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["E  *assert 512 == 600*"])


@pytest.mark.pty
def test_another_program_opens_the_device_by_its_link(pytester: pytest.Pytester) -> None:
    """A client that is no part of this process, as a C++ program would be."""
    pytester.makepyfile(
        program="""
        import sys
        from dynamixel_sdk import PacketHandler, PortHandler
        port = PortHandler(sys.argv[1])
        port.setBaudRate(57600)
        print(PacketHandler(1.0).write2ByteTxRx(port, 7, 30, 321))
        """,
        test_it="""
        import subprocess, sys
        import pytest

        @pytest.mark.busemu_wall
        def test_it(servo_bus, tmp_path):
            bus = servo_bus(model="AX-12A", ids=[5, 7], baud_rate=57600, link=tmp_path / "port")
            assert bus.path == str(tmp_path / "port")
            run = [sys.executable, "program.py", bus.path]
            assert subprocess.run(run, capture_output=True, text=True).stdout == "(0, 0)\\n"
            assert bus.servo(7).register("goal_position") == 321
            assert bus.servo(5).register("goal_position") == 512
            assert bus.counts.transactions == 1
            bus.close()
            assert not (tmp_path / "port").exists()
        """,
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


@pytest.mark.pty
def test_a_server_that_cannot_start_says_why_in_one_line(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest
        from bench.testing import ServoBusError

        def test_it(servo_bus):
            with pytest.raises(ServoBusError, match="no plant named 'clay': use one of"):
                servo_bus("marvin", plant="clay", wall=True)
            with pytest.raises(ServoBusError, match="name an installed plant"):
                servo_bus("marvin", plant=lambda robot: None, wall=True)
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_assertions_see_registers_and_the_truth_behind_them(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest
        from dynamixel_sdk import PacketHandler

        def test_it(servo_bus):
            bus = servo_bus("marvin", timing="ideal")
            packets = PacketHandler(2.0)
            mount = bus.robot.by_joint["leg1.femur"]
            assert mount.zero_rad != 0.0                   # so that the frames differ
            packets.write1ByteTxRx(bus.port, mount.servo_id, 24, 1)
            packets.write1ByteTxRx(bus.port, 1, 24, 1)
            packets.write2ByteTxRx(bus.port, mount.servo_id, 30, 512 + 102)
            before = bus.counts.transactions
            bus.run(2.0)
            shaft_rad = 102 * 300 / 1024 * 3.14159265 / 180
            femur = bus.servo(mount.servo_id)
            assert femur.state.position_rad == pytest.approx(shaft_rad, rel=1e-3)
            joint_rad = mount.to_joint(shaft_rad)
            assert bus.position_rad("leg1.femur") == pytest.approx(joint_rad, rel=1e-3)
            assert femur.register("present_position") == 614
            assert bus.servo(1).registers["model_number"] == 350
            assert bus.counts.transactions == before       # nobody asked over the wire
            assert bus.now_s() == pytest.approx(2.0, abs=0.01)
            packets.write1ByteTxRx(bus.port, 1, 3, 99)     # ID: torque is on, so it stays
            assert bus.servo(1).register("id") == 1
            with pytest.raises(KeyError, match="no servo 77"):
                bus.servo(77)
            with pytest.raises(KeyError, match="no joint"):
                bus.position_rad("leg9.elbow")
            with pytest.raises(KeyError, match="no register"):
                bus.servo(1).register("goal_postion")
            with pytest.raises(RuntimeError, match="--busemu-wall"):
                bus.path
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_looking_at_registers_does_not_feed_a_watchdog(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        from dynamixel_sdk import PacketHandler

        def test_it(servo_bus):
            bus = servo_bus(model="XL430-W250", registers={"return_delay_time": 0})
            watchdog = bus.robot.tables[1]["bus_watchdog"].address
            packets = PacketHandler(2.0)
            packets.write1ByteTxRx(bus.port, 1, 64, 1)
            packets.write1ByteTxRx(bus.port, 1, watchdog, 5)          # 100 ms
            for _ in range(20):
                bus.run(0.01)
                last = bus.servo(1).register("bus_watchdog")
            assert last in (-1, 255)
            assert bus.servo(1).register("return_delay_time") == 0
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_what_has_arrived_stays_for_the_program_while_the_test_looks(
    pytester: pytest.Pytester,
) -> None:
    pytester.makepyfile(
        """
        from dynamixel_sdk import PacketHandler

        def test_it(servo_bus):
            bus = servo_bus("phantomx")
            packets = PacketHandler(1.0)
            packets.txPacket(bus.port, [0, 0, 1, 4, 2, 36, 2, 0])
            bus.port.is_using = False
            bus.run(0.1)
            assert bus.servo(1).register("goal_position") == 512
            assert bus.port.getBytesAvailable() == 8
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_every_test_gets_its_own_buses(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        from dynamixel_sdk import PacketHandler
        import pytest

        @pytest.mark.parametrize("turn", [1, 2])
        def test_it(servo_bus, turn):
            left, right = servo_bus("phantomx"), servo_bus("phantomx")
            assert left.servo(1).register("goal_position") == 512
            PacketHandler(1.0).write2ByteTxRx(left.port, 1, 30, 100)
            assert left.servo(1).register("goal_position") == 100
            assert right.servo(1).register("goal_position") == 512
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=2)


def test_the_command_line_decides_what_a_test_leaves_open(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        def test_open(servo_bus):
            assert servo_bus("marvin").bus.profile.name == "instant"

        def test_decided(servo_bus):
            assert servo_bus("marvin", timing="ideal").bus.profile.name == "ideal"
        """
    )
    pytester.runpytest_subprocess("--busemu-timing", "instant").assert_outcomes(passed=2)


@pytest.mark.parametrize("option", ["--busemu-timing", "--busemu-plant"])
def test_what_the_command_line_misspells_is_refused_once(
    pytester: pytest.Pytester, option: str
) -> None:
    arm(pytester)
    pytester.makepyfile(TEST)
    result = pytester.runpytest_subprocess(f"{option}=nope")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert f"ERROR: {option}: " in result.stderr.str()
    assert "'nope'" in result.stderr.str()


def test_a_plant_that_is_not_installed_says_what_to_install(tmp_path: Path) -> None:
    def absent(robot: Robot) -> Plant:
        raise ModuleNotFoundError("No module named 'engine'", name="engine")

    maker = ServoBusMaker(folder=lambda: tmp_path)
    with pytest.raises(ServoBusError, match=r"the plant needs engine: pip install 'busemu\[sim\]'"):
        maker("marvin", plant=absent)


@pytest.mark.pty
def test_code_that_sleeps_may_be_given_the_time_of_a_pty(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import time

        def test_it_sleeps(servo_bus, monkeypatch):
            bus = servo_bus("marvin", wall=True)
            monkeypatch.setattr("time.sleep", bus.run)
            before_s = bus.now_s()
            time.sleep(0.01)
            assert bus.now_s() - before_s >= 0.01
    """)
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_a_plant_may_be_made_by_the_test(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        from busemu.plant import IdealPlant

        class Closing(IdealPlant):
            closed = 0
            def close(self):
                Closing.closed += 1

        def test_it(servo_bus):
            bus = servo_bus(model="AX-12A", ids=[3], plant=lambda robot: Closing([3]))
            assert type(bus.bus.plant) is Closing

        def test_it_was_closed():
            assert Closing.closed == 1
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=2)


def test_bullet_is_a_plant_like_another(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        def test_it(servo_bus):
            bus = servo_bus("marvin", plant="bullet")
            bus.run(0.02)
            assert 0.0 < bus.observe()["mocap/base_z_m"] < 0.5
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_those_who_do_not_use_it_pay_nothing(pytester: pytest.Pytester) -> None:
    """No heavy import, no warning, no word but pytest's own list of plugins."""
    pytester.makepyfile(
        """
        import sys

        def test_it(request):
            plugin = request.config.pluginmanager.get_plugin("busemu")
            assert plugin.__name__ == "bench.pytest_plugin"
            top = {name.split(".")[0] for name in sys.modules}
            ours = {"busemu", "hal", "sim"}
            heavy = {"numpy", "numba", "pybullet", "dynamixel_sdk", "serial", "typer", "rich"}
            assert not top & (ours | heavy | {"matplotlib", "pyarrow"})
        """
    )
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(passed=1)
    said = [line for line in result.stdout.lines if not line.startswith("plugins: ")]
    assert "busemu" not in "".join(said)
    assert "warning" not in "".join(said)
    assert result.stderr.str() == ""


#: What the examples of the how-to guide need of a robot's own.
OWN_CODE = {
    "my_arm.py": """
        from dynamixel_sdk import PacketHandler

        def go_to(port, servo_id, count):
            PacketHandler(2.0).write1ByteTxRx(port, servo_id, 24, 1)
            PacketHandler(2.0).write2ByteTxRx(port, servo_id, 30, count)

        def read_all(port):
            found = {}
            for servo_id in range(1, 19):
                for _ in range(3):
                    count, result, _ = PacketHandler(2.0).read2ByteTxRx(port, servo_id, 37)
                    if result == 0:
                        found[servo_id] = count
                        break
            return found
        """,
    "my_walk.py": """
        from dynamixel_sdk import GroupSyncRead, PacketHandler

        def one_cycle(port):
            group = GroupSyncRead(port, PacketHandler(2.0), 37, 2)
            for servo_id in range(1, 19):
                group.addParam(servo_id)
            assert group.txRxPacket() == 0
        """,
    "my_robot.py": """
        import time
        from dynamixel_sdk import PacketHandler, PortHandler

        def stand_up(name):
            PacketHandler(2.0).write1ByteTxRx(PortHandler(name), 1, 24, 1)
            time.sleep(10.0)
        """,
    "walk": """
        #!/bin/sh
        test -c "$1"
        """,
}


@pytest.mark.pty
def test_the_examples_of_the_how_to_guide_run(pytester: pytest.Pytester) -> None:
    guide = (Path(__file__).parents[2] / "docs" / "how-to" / "test-in-ci.md").read_text("utf-8")
    blocks = re.findall(r"```python\n(.*?)```", guide, re.DOTALL)
    imports = "import subprocess\nimport my_robot\nimport my_walk\n"
    pytester.makepyfile(test_guide=imports + "\n\n".join(blocks))
    for name, text in OWN_CODE.items():
        (pytester.path / name).write_text(textwrap.dedent(text).lstrip(), "utf-8")
        (pytester.path / name).chmod(0o755)
    pytester.runpytest_subprocess().assert_outcomes(passed=len(blocks))


@pytest.mark.pty
def test_no_server_is_left_when_pytest_is_killed(pytester: pytest.Pytester, tmp_path: Path) -> None:
    link = tmp_path / "port"
    pytester.makepyfile(
        f"""
        import os, pathlib, signal

        def test_it(servo_bus):
            servo_bus("marvin", wall=True, link=pathlib.Path({str(link)!r}))
            os.kill(os.getpid(), signal.SIGKILL)
        """
    )
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", "-q"], cwd=pytester.path, check=False, capture_output=True
    )
    assert ran.returncode == -9
    for _ in range(1000):
        if not link.is_symlink():
            break
        subprocess.run(["sleep", "0.01"], check=True)
    assert not link.is_symlink()
