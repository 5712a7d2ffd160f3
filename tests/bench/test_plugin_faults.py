"""The fixture `faults`, as a user's own test suite meets it."""

from __future__ import annotations

import pytest

pytest_plugins = ["pytester"]

#: A robot's own code that tries again, and one that does not.
ARM = """
    from dynamixel_sdk import COMM_SUCCESS, PacketHandler

    def position(port, servo_id, tries=TRIES):
        packets = PacketHandler(2.0)
        for _ in range(tries):
            value, result, error = packets.read2ByteTxRx(port, servo_id, 37)
            if result == COMM_SUCCESS:
                return value
        raise RuntimeError("no answer")
"""
TEST = """
    from arm import position

    def test_two_lost_replies_are_borne(servo_bus, faults):
        bus = servo_bus("marvin")
        lost = faults.drop(servo=3, count=2)
        assert position(bus.port, 3) == 512
        assert faults.struck(lost) == 2
"""


@pytest.fixture(autouse=True)
def _clean(pytester: pytest.Pytester) -> None:
    pytester.makeini("[pytest]\naddopts = --strict-markers\nfilterwarnings = error")


def test_a_few_lines_test_what_a_program_bears(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(TEST, arm=ARM.replace("TRIES", "3"))
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_the_same_test_fails_where_the_program_does_not_bear_it(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(TEST, arm=ARM.replace("TRIES", "2"))
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["E  *RuntimeError: no answer"])


@pytest.mark.pty
def test_the_same_test_runs_over_a_pty_when_asked(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(TEST, arm=ARM.replace("TRIES", "100"))  # a busy machine may be late
    pytester.runpytest_subprocess("--busemu-wall").assert_outcomes(passed=1)


@pytest.mark.pty
def test_a_port_is_unplugged_and_opened_anew_in_either_time(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import termios, pytest, serial
        from dynamixel_sdk import PacketHandler

        @pytest.mark.parametrize("wall", [False, True])
        def test_it(servo_bus, faults, wall, tmp_path):
            bus = servo_bus("marvin", wall=wall, link=tmp_path / "tty" if wall else None)
            port, packets = bus.port, PacketHandler(2.0)

            def until(seen):  # a busy machine may be late
                for _ in range(200):
                    if ping() is seen:
                        return
                    bus.run(0.1)
                raise AssertionError(f"never {seen}")

            def ping():
                port.is_using = False
                try:
                    return "answers" if packets.ping(port, 1)[1] == 0 else "silent"
                except (termios.error, serial.SerialException):  # on writing, or on reading
                    return "gone"

            until("answers")
            faults.unplug()
            until("gone")
            faults.replug()
            for _ in range(200):
                try:
                    port.openPort()
                    break
                except serial.SerialException:
                    bus.run(0.1)
            port.setBaudRate(1_000_000)
            until("answers")
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=2)


def test_every_kind_of_fault_has_its_method(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        from busemu.faults import Kind

        def test_it(servo_bus, faults):
            servo_bus("marvin")
            for kind in Kind:
                needs = {"servo": 2, "id": 1} if kind is Kind.DUPLICATE_ID else {}
                getattr(faults, kind.value)(after_s=1.0, **needs)
            assert [each.state for each in faults.standing()] == ["waiting"] * len(Kind)
            assert faults.clear() == len(Kind)
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_a_seed_and_a_scenario_make_a_run_repeatable(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest
        from busemu.faults import FaultError
        from dynamixel_sdk import PacketHandler

        def lost(bus):
            return [PacketHandler(2.0).ping(bus.port, 1)[1] for _ in range(30)]

        def test_it(servo_bus, tmp_path):
            path = tmp_path / "faults.toml"
            path.write_text('format="busemu-faults/1"\\nseed=7\\n[[fault]]\\nkind="drop"\\nprobability=0.5')
            runs = []
            for seed in (7, None, 8):
                bus = servo_bus("marvin")
                if seed is None:
                    assert bus.faults.scenario(path) == [1]
                else:
                    bus.faults.seed(seed)
                    bus.faults.drop(probability=0.5)
                runs.append(lost(bus))
            assert runs[0] == runs[1] != runs[2]
            with pytest.raises(FaultError, match="none.toml: cannot be read"):
                bus.faults.scenario(tmp_path / "none.toml")
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_mistakes_are_named(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest
        from bench.testing import ServoBusError
        from busemu.faults import FaultError

        def test_it(servo_bus, faults):
            with pytest.raises(ServoBusError, match="make it first"):
                faults.drop()
            first = servo_bus("marvin")
            with pytest.raises(FaultError, match="servo 99 is not on marvin"):
                faults.drop(servo=99)
            with pytest.raises(FaultError, match="no number and no kind"):
                faults.clear("dorp")
            servo_bus("marvin")
            with pytest.raises(ServoBusError, match="use bus.faults"):
                faults.drop()
            first.faults.drop()
        """
    )
    pytester.runpytest_subprocess().assert_outcomes(passed=1)
