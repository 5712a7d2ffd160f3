"""What befalls servos and the port, as the unmodified SDK sees it, in virtual time."""

from __future__ import annotations

import termios

import pytest
import serial
from fault_bench import FaultBench
from virtual_bus import (
    ALERT_2,
    AX,
    CORRUPT,
    HEAT_1,
    OK,
    OVERLOAD_1,
    RESULT_2,
    TIMEOUT,
    XL,
    ScriptedPlant,
    small_robot,
)

from busemu.faults import FaultError, Faults, Kind, parse_fault
from busemu.plant import OperatingMode, position_duty
from busemu.servo.device import REBOOT_S

BOTH = pytest.mark.parametrize("model", [AX, XL])
X = "XM430-W350"


@BOTH
def test_a_dead_servo_is_mute_and_limp_until_it_is_cleared(model):
    bench = FaultBench(model)
    bench.set("torque_enable", 1, 2)
    number = bench.have("dead", servo=2)
    assert bench.look(2)[1] == TIMEOUT
    assert bench.look(1)[1] == OK
    assert bench.memory("torque_enable", 1) == 0
    bench.clear(number)
    assert bench.look(2)[1] == TIMEOUT
    bench.sleep(REBOOT_S)
    assert bench.look(2)[1] == OK
    assert bench.words == ["dead: servo 2 without power", "dead: over"]


def test_a_dead_servo_silences_those_after_it_in_a_sync_read():
    bench = FaultBench(XL)
    bench.have("dead", servo=2)
    assert bench.sync_read("present_position", (1, 2, 3))[0] == TIMEOUT
    assert len(bench.replies()) == 1
    assert bench.sync_read("present_position", (3, 1))[0] == OK


@BOTH
def test_a_brown_out_forgets_the_ram_keeps_the_eeprom_and_is_silent_for_the_restart(model):
    bench = FaultBench(model)
    bench.set("return_delay_time", 7)
    for servo_id in (1, 2, 3):
        bench.set("torque_enable", 1, servo_id)
        bench.set("goal_position", 300, servo_id)
    bench.sleep(0.5)
    bench.have("brown_out", for_s=0.1)
    assert bench.look()[1] == TIMEOUT
    bench.sleep(0.1 + REBOOT_S)
    for servo_id in (1, 2, 3):
        assert bench.get("torque_enable", servo_id) == 0
    assert bench.get("return_delay_time") == 7
    assert bench.words[0] == "brown-out: all servos without power, for a moment"
    assert bench.faults.standing()[0].state == "over"


def test_two_faults_without_power_overlap_and_the_last_one_to_end_brings_it_back():
    bench = FaultBench(XL)
    first, second = bench.have("dead", servo=1), bench.have("dead", servo=1)
    bench.clear(first)
    bench.sleep(1.0)
    assert bench.look()[1] == TIMEOUT
    bench.clear(second)
    bench.sleep(1.0)
    assert bench.look()[1] == OK


@pytest.mark.parametrize(("model", "expected"), [(AX, OVERLOAD_1), (XL, ALERT_2)])
def test_an_overload_is_shown_and_shuts_down_until_the_servo_starts_again(model, expected):
    bench = FaultBench(model)
    cut = bench.table.drive["shutdown_cuts"]
    bench.set("torque_enable", 1)
    bench.have("overload", servo=1)
    assert bench.look()[2] == expected
    bench.sleep(0.05)
    assert bench.memory(cut) == 0
    assert bench.look(2)[2] == 0
    bench.have("brown_out", servo=1)
    bench.sleep(0.5)
    assert bench.look()[1:] == (OK, 0)


def test_an_overload_of_an_ax_servo_ends_with_a_new_torque_limit():
    bench = FaultBench(AX)
    bench.have("overload", servo=1)
    bench.sleep(0.05)
    bench.write("torque_limit", 500)
    assert bench.look()[1:] == (OK, 0)


def test_an_overload_of_an_x_servo_holds_until_it_is_rebooted():
    bench = FaultBench(small_robot(X), ScriptedPlant.of_twelve_volts())
    bench.set("torque_enable", 1)
    bench.have("overload", servo=1)
    bench.sleep(0.05)
    assert bench.get_anyway("hardware_error_status") == 1 << 5
    assert bench.write("torque_enable", 1) == (OK, ALERT_2 | RESULT_2)
    bench.clear()
    assert bench.look()[2] == ALERT_2
    bench.sdk.reboot(bench.port, 1)
    bench.sleep(2 * REBOOT_S)
    bench.set("torque_enable", 1)


@pytest.mark.parametrize(("model", "expected"), [(AX, HEAT_1), (XL, ALERT_2)])
def test_an_overheated_servo_shows_its_temperature_and_its_alarm_as_long_as_it_lasts(
    model, expected
):
    bench = FaultBench(model)
    bench.have("overheat", servo=1, temperature_c=80, for_s=1.0)
    bench.sleep(0.05)
    assert bench.read("present_temperature")[::2] == (80, expected)
    assert bench.look(2)[2] == 0
    bench.sleep(1.0)
    assert bench.get("present_temperature") == 25


@BOTH
def test_overheated_means_above_the_servos_own_limit_if_nothing_is_said(model):
    bench = FaultBench(model)
    bench.have("overheat")
    bench.sleep(0.05)
    assert bench.read("present_temperature")[0] > bench.memory("temperature_limit")


@BOTH
def test_a_stuck_encoder_shows_one_position_and_lets_the_joint_run(model):
    bench = FaultBench(model)
    bench.set("torque_enable", 1)
    bench.set("goal_position", 700)
    bench.sleep(1.0)
    bench.have("encoder_stuck", servo=1)
    bench.set("goal_position", 600)
    shaft = bench.bus.plant.sample(1).position_rad
    bench.sleep(0.5)
    assert bench.get("present_position") == 700
    # past the goal and on: the servo does not see that it moves
    goal_rad = bench.bus.servos[0]._behaviour.command().goal_position_rad
    assert bench.bus.plant.sample(1).position_rad < goal_rad < shaft
    bench.clear()
    bench.sleep(2.0)
    assert bench.get("present_position") == 600


def test_a_stuck_position_loop_gives_the_duty_of_its_constant_error():
    plant = ScriptedPlant()
    bench = FaultBench(small_robot(AX), plant)
    bench.set("torque_enable", 1)
    bench.set("goal_position", 600)
    healthy = plant.last(1)
    bench.have("encoder_stuck", servo=1)
    stuck = plant.last(1)
    assert stuck.operating_mode is OperatingMode.PWM
    assert stuck.goal_duty == position_duty(healthy, 0.0) > 0.0
    bench.clear()
    assert plant.last(1) == healthy
    assert bench.bus.servos[0].plant is plant


def test_only_a_model_that_has_the_alarm_raises_it_for_its_encoder():
    for model, alarm in ((XL, 0), (X, ALERT_2)):
        plant = ScriptedPlant.of_twelve_volts() if model == X else None
        bench = FaultBench(small_robot(model), plant)
        bench.have("encoder_stuck", servo=1)
        assert bench.look()[2] == alarm


@BOTH
def test_two_servos_with_one_id_answer_at_once_and_collide_until_it_is_cleared(model):
    bench = FaultBench(model)
    bench.set("goal_position", 200, 1)
    bench.set("goal_position", 823, 2)
    bench.have("duplicate_id", servo=2, id=1)
    assert bench.look(2)[1] == TIMEOUT
    value, result, _ = bench.read("goal_position", 1)
    assert (result, value) in ((CORRUPT, 0), (TIMEOUT, 0))
    assert bench.words == ["duplicate-id: servo 2 has taken ID 1"]
    bench.clear()
    assert bench.get("goal_position", 1) == 200
    assert bench.get("goal_position", 2) == 823


def test_an_id_that_a_program_has_mended_stays_mended():
    bench = FaultBench(XL, None)
    bench.have("duplicate_id", servo=2, id=9)
    bench.set("id", 5, 9)
    bench.clear()
    assert [servo.servo_id for servo in bench.bus.servos] == [1, 5, 3]


@BOTH
def test_an_unplugged_port_fails_as_pyserial_does_and_has_to_be_opened_anew(model):
    bench = FaultBench(model)
    bench.have("unplug", for_s=1.0)
    with pytest.raises(termios.error, match="Input/output error"):
        bench.look()
    with pytest.raises(OSError, match="Input/output error"):
        bench.port.getBytesAvailable()
    with pytest.raises(serial.SerialException):
        bench.port.writePort(b"\\xff")
    with pytest.raises(serial.SerialException):
        bench.port.readPort(1)
    with pytest.raises(serial.SerialException):
        bench.port.openPort()
    bench.sleep(1.0)
    bench.port.is_using = False  # the SDK leaves it as it was when an error came
    with pytest.raises(termios.error):
        bench.look()
    bench.port.is_using = False
    assert bench.port.openPort()
    assert bench.look()[1] == OK
    assert bench.words == ["unplug: the port is away", "unplug: over"]


@pytest.mark.parametrize("after_s", [0.0, 0.005])
def test_a_reply_on_its_way_is_lost_with_the_port(after_s):
    """On the wire while the port is away, or in the adapter (for 16 ms) when it goes."""
    bench = FaultBench(XL, profile="ftdi-16ms")
    bench.bus.receive(bench.packet(1), bench.now_s())
    bench.have("unplug", after_s=after_s, for_s=0.005)
    assert bench.sleep(1.0) == b""
    assert bench.replies()


def test_a_port_that_was_unplugged_twice_comes_back_with_the_last_of_them():
    bench = FaultBench(XL)
    first, second = bench.have("unplug"), bench.have("unplug")
    bench.clear(first)
    with pytest.raises(serial.SerialException):
        bench.port.openPort()
    bench.clear(second)
    assert bench.port.openPort()
    assert bench.look()[1] == OK


def test_a_port_that_cannot_be_unplugged_says_so():
    bench = FaultBench(XL)
    faults = Faults(bench.bus, bench.robot, bench.faults.draw)
    with pytest.raises(FaultError, match="pull the plug"):
        faults.add(parse_fault({"kind": "unplug"}, "test", bench.robot))


def test_a_fault_waits_strikes_and_is_over_at_the_instants_asked_for():
    bench = FaultBench(XL)
    bench.have("dead", servo=1, after_s=1.0, for_s=2.0)
    seen = []
    for _ in range(8):
        bench.sleep(0.5)
        bench.bus.advance_plant(bench.now_s())
        seen.append(bench.faults.standing()[0].state)
    assert seen == ["waiting"] + 4 * ["active"] + 3 * ["over"]


def test_a_fault_that_is_cleared_before_its_time_never_strikes():
    bench = FaultBench(XL)
    bench.have("overload", servo=1, after_s=1.0)
    bench.clear(Kind.OVERLOAD)
    bench.sleep(2.0)
    assert bench.look()[1:] == (OK, 0)
    assert bench.words == []


def test_clearing_ends_one_number_one_kind_or_all():
    bench = FaultBench(XL)
    first, _, _ = bench.have("drop"), bench.have("drop"), bench.have("noise")
    assert bench.faults.clear(first) == 1
    assert bench.faults.clear(Kind.DROP) == 1
    assert bench.faults.clear(Kind.DROP) == 0
    assert bench.faults.clear() == 1
    assert bench.faults.standing() == []


def test_faults_are_bounded_and_those_that_are_over_make_room():
    bench = FaultBench(XL)
    for _ in range(256):
        bench.have("drop", for_s=1.0)
    with pytest.raises(FaultError, match="clear some"):
        bench.have("drop")
    bench.sleep(2.0)
    bench.have("drop", count=1)
    assert len(bench.faults.standing()) == 1
