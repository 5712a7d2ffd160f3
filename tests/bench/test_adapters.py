"""Adapter profiles: the mechanisms they name give the figures that users of adapters tell of."""

from __future__ import annotations

import tomllib
from dataclasses import fields, replace

import pytest

from bench.probes import Condition, Kind, Probe, prober_in_process
from bench.testing import ServoBusMaker
from busemu.tables import Robot
from busemu.timing import PROFILES, Profile, load_profile

ADAPTERS = ("ftdi-16ms", "ftdi-1ms", "u2d2", "usb2dynamixel", "usb2ax", "uart")
POSITION = 2  # bytes: present_position, Protocol 1.0


@pytest.fixture
def chain(tmp_path):
    """Servos of one model, one after the other, at 1 Mbps if nothing else is said."""

    def make(model: str, count: int, baud_rate: int = 1_000_000) -> Robot:
        maker = ServoBusMaker(folder=lambda: tmp_path)
        return maker(model=model, ids=range(1, count + 1), baud_rate=baud_rate).robot

    return make


def took_s(robot: Robot, profile: Profile, probe: Probe, *, delay: int = 0) -> float:
    condition = Condition(robot.baud_rate, (delay,) * len(robot.servos))
    (timing,) = prober_in_process(robot, profile, condition).time([probe], 1)
    return timing.median_s


def test_12_servos_one_by_one_take_0_19_s_at_a_latency_timer_of_16_ms(chain):
    """DynamixelSDK issue 146, 12 MX-64: 0.19 s and, on another system, 0.011 s."""
    robot, each = chain("MX-64", 12), Probe(Kind.READ_EACH, 12, POSITION)
    slow_s = took_s(robot, load_profile("ftdi-16ms"), each)
    quick_s = took_s(robot, load_profile("ftdi-1ms"), each)
    assert slow_s == pytest.approx(0.19, rel=0.05)
    assert 0.011 < quick_s < 12 * 2e-3  # between what issue 146 and what issue 330 say
    assert slow_s / quick_s > 10.0


def test_one_read_takes_about_15_ms_at_16_and_about_2_ms_at_1(chain):
    """DynamixelSDK issues 330 and 134; the sources conflict by 1 ms, as the profiles say."""
    robot, read = chain("MX-12W", 1), Probe(Kind.READ, 1, POSITION)
    for name in ("ftdi-16ms", "usb2dynamixel", "u2d2"):
        assert took_s(robot, load_profile(name), read) == pytest.approx(15e-3, rel=0.1)
    quick = load_profile("ftdi-1ms")
    assert took_s(robot, quick, read) == pytest.approx(1.365e-3, abs=0.05e-3)
    assert took_s(robot, quick, read, delay=250) == pytest.approx(2e-3, rel=0.15)


def test_6_servos_at_4_mbps_take_about_4_ms_by_sync_read_and_over_6_ms_one_by_one(chain):
    """DynamixelSDK issue 302, "more than 4 ms": timer 1 ms, factory return delay."""
    robot = chain("XM430-W350", 6, 4_000_000)
    profile = replace(load_profile("u2d2"), latency_timer_s=1e-3)
    sync_s = took_s(robot, profile, Probe(Kind.SYNC_READ, 6, 4), delay=250)
    each_s = 6 * took_s(robot, profile, Probe(Kind.READ, 1, 4), delay=250)
    assert sync_s == pytest.approx(4e-3, rel=0.05)
    assert each_s > 6e-3
    assert sync_s == pytest.approx(3.9e-3, abs=0.05e-3)  # as the profile says
    assert each_s == pytest.approx(10.6e-3, abs=0.05e-3)


def test_timer_of_a_high_speed_chip_waits_at_the_end_of_a_sync_read_too(chain):
    """At full speed 62 bytes go up at once; 18 replies of 15 bytes do not fill 510."""
    robot, sync = chain("XL430-W250", 18), Probe(Kind.SYNC_READ, 18, 4)
    full_speed = replace(load_profile("u2d2"), chunk_bytes=62)
    at_first_byte_s = took_s(robot, load_profile("u2d2"), Probe(Kind.SYNC_READ, 1, 4))
    assert took_s(robot, load_profile("u2d2"), sync) == pytest.approx(at_first_byte_s, abs=0.3e-3)
    assert took_s(robot, full_speed, sync) > 18e-3  # the last chunk's timer starts late


def test_adapters_without_a_latency_timer_take_less_than_a_millisecond(chain):
    robot, read = chain("AX-12A", 1), Probe(Kind.READ, 1, POSITION)
    usb2ax_s = took_s(robot, load_profile("usb2ax"), read)
    uart_s = took_s(robot, load_profile("uart"), read)
    wire_s = 0.16e-3
    assert wire_s + 22e-6 < uart_s < usb2ax_s < 0.6e-3
    assert took_s(robot, load_profile("usb2ax"), read, delay=250) == pytest.approx(
        usb2ax_s + 500e-6 - 22e-6
    )


@pytest.mark.parametrize("name", ADAPTERS)
def test_every_value_of_an_adapter_has_its_source_or_is_called_assumed(name):
    text = (PROFILES / f"{name}.toml").read_text("utf-8")
    known = {field.name for field in fields(Profile)}
    lines = [line for line in text.splitlines() if line.partition(" = ")[0] in known]
    assert {line.partition(" = ")[0] for line in lines} == set(tomllib.loads(text))
    for line in lines:
        if not line.startswith("source"):
            remark = line.partition("#")[2]
            assert any(word in remark for word in ("source:", "assumed", "manual", "set by")), line
