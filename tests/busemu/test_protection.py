"""Alarms and shutdown, the load register, and what the registers tell the drive."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from virtual_bus import (
    ALERT_2,
    AX,
    HEAT_1,
    OK,
    OVERLOAD_1,
    RESULT_2,
    VOLTAGE_1,
    XL,
    Bench,
    ScriptedPlant,
)

BOTH = pytest.mark.parametrize("model", [AX, XL])
COUNT_RAD = math.radians(300.0 / 1024.0)


def on(model: str) -> tuple[Bench, ScriptedPlant]:
    """Servos with their torque on."""
    plant = ScriptedPlant()
    bench = Bench(model, plant)
    for i in (1, 2, 3):
        bench.set("torque_enable", 1, i)
    return bench, plant


def alarm_of(bench: Bench) -> int:
    """The error byte of a ping."""
    return bench.ping()[2]


# -- alarms -------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("wrong_v", [5.9, 14.1])
def test_voltage_outside_its_limits_raises_the_alarm_for_as_long_as_it_lasts(
    model: str, wrong_v: float
) -> None:
    bench, plant = on(model)
    plant.voltage_v = wrong_v
    bench.sleep(0.05)
    assert alarm_of(bench) == (VOLTAGE_1 if model == AX else ALERT_2)
    if model == XL:
        assert bench.read("hardware_error_status") == (4, OK, ALERT_2)
    # neither model shuts down for it as delivered
    assert bench.read("torque_enable")[0] == 1
    assert bench.read("torque_limit")[0] == 1023
    plant.voltage_v = 7.4
    bench.sleep(0.05)
    assert alarm_of(bench) == 0


@BOTH
def test_voltage_at_its_limits_is_in_order(model: str) -> None:
    bench, plant = on(model)
    for volts in (6.0, 14.0 if model == AX else 9.0):
        plant.voltage_v = volts
        bench.sleep(0.05)
        assert alarm_of(bench) == 0
        assert bench.get("present_voltage") == round(volts * 10)


@BOTH
def test_heat_raises_the_alarm_and_shuts_down(model: str) -> None:
    bench, plant = on(model)
    plant.temperature_c = 71.0
    bench.sleep(0.05)
    assert alarm_of(bench) == (HEAT_1 if model == AX else ALERT_2)
    assert bench.read("present_temperature")[0] == 71
    if model == AX:
        assert bench.read("torque_limit")[0] == 0
        assert plant.last().duty_limit == 0.0
    else:
        assert bench.read("hardware_error_status")[0] == 2
        assert bench.read("torque_enable")[0] == 0
        assert not plant.last().torque_enable


@BOTH
def test_shutdown_register_chooses_what_shuts_down(model: str) -> None:
    plant = ScriptedPlant()
    bench = Bench(model, plant)
    bench.set("shutdown", 1 if model == AX else 4)  # voltage alone
    bench.set("torque_enable", 1)
    plant.temperature_c = 71.0
    bench.sleep(0.05)
    assert bench.read("torque_enable")[0] == 1
    assert bench.read("torque_limit")[0] == 1023
    plant.voltage_v = 5.0
    bench.sleep(0.05)
    assert bench.read("torque_limit" if model == AX else "torque_enable")[0] == 0


@BOTH
def test_overload_needs_a_stalled_joint_at_full_duty_for_a_while(model: str) -> None:
    bench, plant = on(model)
    plant.duty = -1.0
    bench.sleep(0.5)
    plant.velocity_rad_s = 2.0  # it slews: no stall
    bench.sleep(5.0)
    plant.velocity_rad_s = 0.0
    bench.sleep(0.8)
    plant.duty = -0.5
    bench.sleep(5.0)
    plant.duty = -1.0
    bench.sleep(0.8)
    assert alarm_of(bench) == 0
    bench.sleep(0.3)
    assert alarm_of(bench) == (OVERLOAD_1 if model == AX else ALERT_2)


def test_overload_of_an_ax_takes_its_torque_limit_until_it_is_written() -> None:
    bench, plant = on(AX)
    plant.duty = 1.0
    bench.sleep(1.1)
    assert bench.read("torque_limit") == (0, OK, OVERLOAD_1)
    assert plant.last().duty_limit == 0.0
    assert plant.last().torque_enable
    plant.duty = 0.0
    bench.sleep(1.0)
    assert bench.read("torque_limit") == (0, OK, OVERLOAD_1)
    assert bench.write("torque_limit", 1023)[0] == OK
    assert alarm_of(bench) == 0
    assert plant.last().duty_limit == pytest.approx(1.0, abs=1e-3)


def test_overload_of_an_xl320_switches_its_torque_off_until_a_reboot() -> None:
    bench, plant = on(XL)
    plant.duty = 1.0
    bench.sleep(1.1)
    assert bench.read("hardware_error_status") == (1, OK, ALERT_2)
    assert bench.read("torque_enable") == (0, OK, ALERT_2)
    assert not plant.last().torque_enable
    plant.duty = 0.0
    bench.sleep(1.0)
    assert bench.write("torque_enable", 1) == (OK, ALERT_2 | RESULT_2)
    assert bench.sdk.reboot(bench.port, 1)[0] == OK
    bench.sleep(1.0)
    assert alarm_of(bench) == 0
    assert bench.get("hardware_error_status") == 0
    bench.set("torque_enable", 1)
    assert plant.last().torque_enable


@BOTH
def test_alarm_of_one_servo_is_not_its_neighbours(model: str) -> None:
    plant = ScriptedPlant()
    bench = Bench(model, plant)
    bench.set("max_voltage_limit", 70, 2)
    bench.sleep(0.05)
    assert [bench.ping(i)[2] != 0 for i in (1, 2, 3)] == [False, True, False]


# -- the load register --------------------------------------------------------------------------


@BOTH
def test_load_register_is_renewed_only_every_130_ms(model: str) -> None:
    bench, plant = on(model)
    plant.velocity_rad_s = 1.0
    seen = []
    for step in range(1500):
        plant.duty = (step % 1000) / 1000
        bench.sleep(0.001)
        seen.append((bench.now_s(), bench.memory("present_load")))
    changes = [t for (_, a), (t, b) in pairwise(seen) if a != b]
    gaps = [after - before for before, after in pairwise(changes)]
    assert len(gaps) >= 8
    assert all(0.129 <= gap <= 0.141 for gap in gaps)
    assert sum(gaps) / len(gaps) == pytest.approx(0.130, abs=0.0005)


@BOTH
@pytest.mark.parametrize(
    ("duty", "raw"), [(0.5, 512), (-0.5, 1024 + 512), (1.0, 1023), (-2.0, 2047)]
)
def test_load_is_the_duty_with_its_sign_in_bit_10(model: str, duty: float, raw: int) -> None:
    bench, plant = on(model)
    plant.velocity_rad_s = 1.0
    plant.duty = duty
    bench.sleep(0.2)
    assert bench.get("present_load") == pytest.approx(raw, abs=1)


def test_the_load_of_an_sts3215_has_its_sign_exchanged() -> None:
    """Public logs: positive while the servo drives to smaller positions."""
    bench, plant = on("STS3215:1-3")
    plant.velocity_rad_s = 1.0
    plant.duty = -0.25
    bench.sleep(0.2)
    assert bench.get("present_load") == pytest.approx(250, abs=1)


@BOTH
def test_load_is_made_from_the_position_error(model: str) -> None:
    """On the ideal plant, which knows no torque at all."""
    bench = Bench(model)
    if model == AX:  # a band of 128 counts, and from 512 a goal 100 counts off
        for side in ("cw", "ccw"):
            bench.set(f"{side}_compliance_slope", 128)
    bench.set("moving_speed", 1)
    bench.set("goal_position", 612)
    bench.set("torque_enable", 1)
    bench.sleep(0.15)
    load = bench.get("present_load")
    expected = (
        32 + (1023 - 32) * 99 / 128 if model == AX else 1023 * 0.158 * 32 * 100 * COUNT_RAD + 32
    )
    assert load == pytest.approx(min(1023, expected), rel=0.03)


# -- registers to drive -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("raw", "step"),
    [(0, 2), (2, 2), (3, 2), (4, 4), (7, 4), (8, 8), (15, 8), (16, 16), (31, 16), (32, 32),
     (63, 32), (64, 64), (127, 64), (128, 128), (254, 128)],
)  # fmt: skip
def test_compliance_slope_acts_in_seven_steps(raw: int, step: int) -> None:
    bench, plant = on(AX)
    bench.set("cw_compliance_slope", raw)
    command = plant.last()
    punch = 32 * 0.000977517
    assert command.gain_cw_per_rad == pytest.approx((1 - punch) / (step * COUNT_RAD))
    assert command.gain_ccw_per_rad == pytest.approx((1 - punch) / (32 * COUNT_RAD))


def test_margins_and_punch_reach_the_drive_each_side_its_own() -> None:
    bench, plant = on(AX)
    bench.set("cw_compliance_margin", 3)
    bench.set("ccw_compliance_margin", 5)
    bench.set("punch", 100)
    command = plant.last()
    assert command.margin_cw_rad == pytest.approx(3 * COUNT_RAD)
    assert command.margin_ccw_rad == pytest.approx(5 * COUNT_RAD)
    assert command.punch_duty == pytest.approx(100 / 1023, rel=1e-5)


def test_p_gain_reaches_the_drive() -> None:
    bench, plant = on(XL)
    before = plant.last().gain_cw_per_rad
    bench.set("p_gain", 64)
    assert plant.last().gain_cw_per_rad == plant.last().gain_ccw_per_rad
    assert plant.last().gain_cw_per_rad == pytest.approx(2 * before)


@BOTH
def test_goal_speed_and_torque_limit_reach_the_drive_in_si(model: str) -> None:
    bench, plant = on(model)
    assert plant.last().velocity_limit_rad_s == math.inf  # moving speed 0 is no limit
    bench.set("moving_speed", 100)
    bench.set("torque_limit", 512)
    bench.set("goal_position", 412)
    command = plant.last()
    assert command.velocity_limit_rad_s == pytest.approx(11.1 * math.pi / 30)
    assert command.duty_limit == pytest.approx(512 / 1023, rel=1e-4)
    assert command.goal_position_rad == pytest.approx(-100 * COUNT_RAD)
    assert command.operating_mode.value == "position"


# -- what is read is what is, when it is looked at ----------------------------------------------


def ramp(rad_s: float, plant: ScriptedPlant) -> None:
    plant.angle = lambda servo_id, now_s: (now_s * rad_s) % 4.0 - 2.0


@BOTH
@pytest.mark.parametrize("profile", ["ideal", "thesis"])
def test_position_read_is_that_of_the_instant_the_servo_latches(model: str, profile: str) -> None:
    """The end of the instruction packet on the wire, and the turnaround, to 2 us of 0.29 deg."""
    if profile == "thesis":
        profile = "thesis-phantomx" if model == AX else "thesis-marvin"
    plant = ScriptedPlant()
    bench = Bench(model, plant, profile)
    speed = 2000.0  # rad/s: a count lasts 2.6 us
    ramp(speed, plant)
    for _ in range(20):
        bench.sleep(0.0137)
        value = bench.get("present_position")
        asked = [event for event in bench.wire if event.kind.name == "INSTRUCTION"][-1]
        latch_s = asked.end_s + bench.bus.profile.turnaround_s
        angle = plant.angle(1, latch_s)
        assert value == max(0, min(1023, round(angle / COUNT_RAD) + 512))


def test_18_joints_of_a_sync_read_are_18_instants() -> None:
    plant = ScriptedPlant(range(1, 19))
    bench = Bench("marvin", plant, "thesis-marvin")
    speed = 100.0
    plant.angle = lambda servo_id, now_s: (now_s - 1.0) * speed - 2.0
    bench.sleep(1.0 - bench.now_s())
    result, values = bench.sync_read("present_position", range(1, 19))
    assert result == OK
    (asked, *replies) = bench.wire[-19:]
    for index, before in enumerate([asked, *replies[:-1]]):
        latch_s = before.end_s + bench.bus.profile.turnaround_s
        angle = plant.angle(1, latch_s)
        assert values[index + 1] == round(angle / COUNT_RAD) + 512
    assert sorted(values.values()) == list(values.values())
    assert len(set(values.values())) == 18


@BOTH
def test_sensor_beyond_its_range_reads_the_end_of_it(model: str) -> None:
    plant = ScriptedPlant()
    bench = Bench(model, plant)
    for angle, count in ((3.0, 1023), (-3.0, 0)):
        plant.angle = lambda servo_id, now_s, a=angle: a
        assert bench.get("present_position") == count
    plant.velocity_rad_s = -1000.0
    assert bench.get("present_speed") == 2047
    assert bench.get("moving") == 1
    plant.velocity_rad_s = 0.01
    assert bench.get("moving") == 0


@BOTH
def test_present_speed_carries_its_direction_in_bit_10(model: str) -> None:
    plant = ScriptedPlant()
    bench = Bench(model, plant)
    for velocity, raw in ((1.0, 86), (-1.0, 1024 + 86)):
        plant.velocity_rad_s = velocity
        assert bench.get("present_speed") == raw


@BOTH
def test_command_acts_at_the_instant_the_packet_is_taken(model: str) -> None:
    profile = "thesis-phantomx" if model == AX else "thesis-marvin"
    plant = ScriptedPlant()
    bench = Bench(model, plant, profile)
    bench.set("goal_position", 700)
    (asked,) = [event for event in bench.wire if event.kind.name == "INSTRUCTION"]
    acted_s, command = plant.commands[1][-1]
    assert acted_s == pytest.approx(asked.end_s + bench.bus.profile.turnaround_s, abs=1e-12)
    assert command.goal_position_rad == pytest.approx(188 * COUNT_RAD)
