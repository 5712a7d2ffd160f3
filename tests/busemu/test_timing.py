"""Modelled times, seen by the official SDK's packet handlers in virtual time."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import pytest
from virtual_bus import AX, IDEAL, OK, ROBOT, TIMEOUT, XL, Bench

from busemu.timing import Profile, ProfileError, Uplink, load_profile, profiles

IDS = range(1, 19)
BOTH = pytest.mark.parametrize("model", [AX, XL])


def robot_bench(model: str, profile: Profile | str = IDEAL) -> Bench:
    return Bench(ROBOT[model], profile=profile)


def write_all(bench: Bench, size: int) -> int:
    """One sync write of goal position, or of goal position and moving speed, to all 18."""
    data = b"\x00\x02" if size == 2 else b"\x00\x02\xff\x01"
    return bench.sync_write(30, dict.fromkeys(IDS, data))


def wire_ms(bench: Bench) -> float:
    """Time the last instruction packet takes on the wire."""
    event = bench.wire[-1]
    return (event.end_s - event.start_s) * 1e3


# -- the thesis's figures -----------------------------------------------------------------------


def test_ax_read_takes_1_ms() -> None:
    bench = robot_bench(AX, "thesis-phantomx")
    assert bench.ms(lambda: bench.get("present_position", 7)) == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("size", [2, 4])
def test_ax_cycle_of_a_sync_write_and_18_reads_takes_19_ms(size: int) -> None:
    bench = robot_bench(AX, "thesis-phantomx")

    def cycle() -> None:
        assert write_all(bench, size) == OK
        for i in IDS:
            bench.get("present_position", i)

    assert bench.ms(cycle) == pytest.approx(19.0, rel=0.01)
    assert bench.ms(cycle) == pytest.approx(19.0, rel=0.01)


def test_xl_read_takes_3_ms() -> None:
    bench = robot_bench(XL, "thesis-marvin")
    assert bench.ms(lambda: bench.get("present_position", 7)) == pytest.approx(3.0, rel=0.01)


def test_xl_sync_read_of_18_takes_13_ms() -> None:
    bench = robot_bench(XL, "thesis-marvin")

    def read_all() -> None:
        result, values = bench.sync_read("present_position", IDS)
        assert result == OK
        assert list(values) == list(IDS)

    assert bench.ms(read_all) == pytest.approx(13.0, rel=0.01)
    bench.sleep(0.0173)
    assert bench.ms(read_all) == pytest.approx(13.0, rel=0.01)


@BOTH
def test_write_of_all_18_is_on_the_wire_within_1_ms(model: str) -> None:
    bench = robot_bench(model, load_profile(Bench(ROBOT[model]).robot.timing))
    before_s = bench.now_s()
    assert write_all(bench, 2) == OK
    bench.sleep(0.01)
    assert bench.wire[-1].end_s - before_s <= 1e-3
    assert all(bench.memory("goal_position", i) == 512 for i in range(18))


def test_write_of_position_and_speed_to_18_ax_is_on_the_wire_in_about_1_ms() -> None:
    bench = robot_bench(AX, "thesis-phantomx")
    before_s = bench.now_s()
    write_all(bench, 4)
    bench.sleep(0.01)
    assert (bench.wire[-1].end_s - before_s) * 1e3 == pytest.approx(0.98 + 0.195 + 0.04, abs=0.01)


# -- mechanism: wire and return delay only ------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "delay", "expected_ms"),
    [
        (AX, 250, 0.66),
        (AX, 0, 0.16),
        (AX, 10, 0.18),
        (XL, 250, 0.77),
        (XL, 0, 0.27),
        (XL, 254, 0.778),
    ],
)
def test_read_takes_the_wire_and_the_return_delay(
    model: str, delay: int, expected_ms: float
) -> None:
    bench = robot_bench(model)
    bench.set("return_delay_time", delay)
    took = bench.ms(lambda: bench.get("present_position"))
    assert took == pytest.approx(expected_ms, abs=1e-6)


@pytest.mark.parametrize(("delay", "expected_ms"), [(250, 11.66), (0, 2.66)])
def test_sync_read_of_18_takes_the_wire_and_each_return_delay(
    delay: int, expected_ms: float
) -> None:
    bench = robot_bench(XL)
    for i in IDS:
        bench.set("return_delay_time", delay, i)
    took = bench.ms(lambda: bench.sync_read("present_position", IDS))
    assert took == pytest.approx(expected_ms, abs=1e-6)


@pytest.mark.parametrize(("size", "expected_ms"), [(2, 0.62), (4, 0.98)])
def test_sync_write_to_18_takes_the_wire_whatever_the_return_delay(
    size: int, expected_ms: float
) -> None:
    bench = robot_bench(AX)
    write_all(bench, size)
    bench.sleep(0.002)
    assert wire_ms(bench) == pytest.approx(expected_ms, abs=1e-6)


def test_return_delay_of_a_write_is_the_one_before_the_write() -> None:
    bench = robot_bench(AX)
    assert bench.ms(lambda: bench.set("return_delay_time", 0)) == pytest.approx(0.64, abs=1e-6)
    assert bench.ms(lambda: bench.set("return_delay_time", 0)) == pytest.approx(0.14, abs=1e-6)


@pytest.mark.parametrize(("model", "bytes_", "turn_ms"), [(AX, 16, 0.5), (XL, 27, 0.5)])
def test_at_57600_baud_each_byte_takes_17_times_as_long(
    model: str, bytes_: int, turn_ms: float
) -> None:
    bench = robot_bench(model)
    bench.set("baud_rate", 34 if model == AX else 1)
    assert bench.read("present_position")[1] == TIMEOUT
    bench.port.setBaudRate(57_600)
    took = bench.ms(lambda: bench.get("present_position"))
    # An AX at 57 600 really runs at 2 MHz / 35, within what a UART forgives.
    assert took == pytest.approx(bytes_ * 10 / 57.6 + turn_ms, abs=1e-6)


def test_turnaround_is_the_least_reply_time() -> None:
    bench = robot_bench(AX, replace(IDEAL, turnaround_s=22e-6))
    assert bench.ms(lambda: bench.get("present_position")) == pytest.approx(0.66, abs=1e-6)
    bench.set("return_delay_time", 0)
    assert bench.ms(lambda: bench.get("present_position")) == pytest.approx(0.182, abs=1e-6)


def test_control_interrupt_holds_a_reply_back_by_its_mean() -> None:
    profile = replace(IDEAL, interrupt_period_s=1e-3, interrupt_busy_s=130e-6)
    bench = robot_bench(AX, profile)
    extra = 0.130**2 / 2  # met with probability 0.13, then half of it left
    assert bench.ms(lambda: bench.get("present_position")) == pytest.approx(0.66 + extra)


def test_usb_frame_costs_half_a_frame_each_way() -> None:
    bench = robot_bench(AX, replace(IDEAL, usb_frame_s=1e-3))
    assert bench.ms(lambda: bench.get("present_position")) == pytest.approx(1.66)


# -- latency timer and chunks -------------------------------------------------------------------


@pytest.mark.parametrize(("timer_ms", "expected_ms"), [(1, 1.59), (2, 2.59), (16, 16.59)])
def test_short_reply_waits_for_the_latency_timer(timer_ms: int, expected_ms: float) -> None:
    """It starts with the first byte of the reply: 0.08 out, 0.5 delay, 0.01, then the timer."""
    profile = replace(IDEAL, latency_timer_s=timer_ms / 1e3, chunk_bytes=62)
    bench = robot_bench(AX, profile)
    assert bench.ms(lambda: bench.get("present_position")) == pytest.approx(expected_ms)


def test_18_reads_at_a_latency_timer_of_16_ms_take_18_times_16() -> None:
    bench = robot_bench(AX, replace(IDEAL, latency_timer_s=16e-3, chunk_bytes=62))

    def read_all() -> None:
        for i in IDS:
            bench.get("present_position", i)

    assert bench.ms(read_all) == pytest.approx(18 * 16.59)


def test_full_chunk_does_not_wait_for_the_timer() -> None:
    """Five replies of 13 bytes overfill 62: the 62nd byte takes the whole chunk up."""
    profile = replace(IDEAL, latency_timer_s=16e-3, chunk_bytes=62)
    bench = robot_bench(XL, profile)
    bench.port.writePort(bench.packet(0x82, [37, 0, 2, 0, *range(1, 6)], 254))
    ready_s = []
    got = bytearray()
    while len(got) < 65:
        bench.clock.sleep_until(bench.bus.next_deadline_s())
        data = bench.bus.poll(bench.now_s())
        if data:
            ready_s.append((len(data), bench.now_s()))
            got += data
    # out 0.19, five times 0.5 + 0.13, less the last three bytes; then the timer for those
    (first, first_s), (second, second_s) = ready_s
    assert (first, second) == (62, 3)
    assert first_s * 1e3 == pytest.approx(0.19 + 5 * 0.63 - 0.03)
    assert second_s * 1e3 == pytest.approx(0.19 + 5 * 0.63 - 0.02 + 16)


def test_uplink_hands_bytes_up_at_the_timer_though_more_come_later() -> None:
    uplink = Uplink(replace(IDEAL, latency_timer_s=1e-3, chunk_bytes=62))
    uplink.carry(b"ab", 0.0, 1e-5)
    assert uplink.next_deadline_s() == pytest.approx(1.01e-3)
    uplink.carry(b"cd", 5e-3, 1e-5)
    assert uplink.poll(1.0e-3) == b""
    assert uplink.poll(1.02e-3) == b"ab"
    assert uplink.poll(6.0e-3) == b""
    assert uplink.poll(6.02e-3) == b"cd"
    assert uplink.next_deadline_s() is None


@pytest.mark.parametrize("lengths", [(8,), (3, 5, 1), (20,), (7, 20)])
@pytest.mark.parametrize("chunk_bytes", [8, 62])
def test_uplink_hands_a_run_up_as_its_bytes_one_by_one(
    lengths: tuple[int, ...], chunk_bytes: int
) -> None:
    byte_s = 2.0**-14  # sums of it are exact
    profile = replace(IDEAL, latency_timer_s=16 * byte_s, chunk_bytes=chunk_bytes)
    whole, single = Uplink(profile), Uplink(profile)
    start_s = 0.0
    for length in lengths:
        run = bytes(range(length))
        whole.carry(run, start_s, byte_s)
        for i in range(length):
            single.carry(run[i : i + 1], start_s + i * byte_s, byte_s)
        start_s += (length + 2) * byte_s
    while (ready_s := single.next_deadline_s()) is not None:
        assert whole.next_deadline_s() == ready_s
        assert whole.poll(ready_s) == single.poll(ready_s)
    assert whole.next_deadline_s() is None


def test_baud_rate_return_delay_and_timer_each_move_the_thesis_profile() -> None:
    base = load_profile("thesis-marvin")

    def read_ms(profile: Profile, delay: int = 250) -> float:
        bench = robot_bench(XL, profile)
        bench.set("return_delay_time", delay)
        return bench.ms(lambda: bench.get("present_position"))

    assert read_ms(base) == pytest.approx(3.0, rel=0.01)
    assert read_ms(base, 0) == pytest.approx(2.522, rel=0.01)  # not below the turnaround
    assert read_ms(replace(base, latency_timer_s=16e-3)) == pytest.approx(18.0, rel=0.01)


# -- silence ------------------------------------------------------------------------------------


@BOTH
def test_absent_servo_costs_the_sdk_34_ms(model: str) -> None:
    bench = robot_bench(model)
    assert bench.ms(lambda: bench.ping(99)) == pytest.approx(34.13, abs=0.08)
    assert bench.ping(99)[1] == TIMEOUT


def test_sync_read_with_an_absent_servo_loses_all_after_it_and_takes_36_ms() -> None:
    bench = robot_bench(XL)
    ids = [1, 2, 3, 99, *range(5, 19)]
    before_s = bench.now_s()
    result, values = bench.sync_read("present_position", ids)
    assert result == TIMEOUT
    assert (bench.now_s() - before_s) * 1e3 == pytest.approx(36.4, abs=0.1)
    assert values.keys() <= {1, 2, 3}
    replies = [event for event in bench.wire if event.kind.name == "STATUS"]
    assert [event.data[4] for event in replies] == [1, 2, 3]


@pytest.mark.parametrize("profile", ["ideal", "instant", "thesis-marvin"])
def test_broadcast_ping_finds_all_18_and_takes_807_ms(profile: str) -> None:
    bench = robot_bench(XL, profile)
    before_s = bench.now_s()
    found, result = bench.sdk.broadcastPing(bench.port)
    assert result == OK
    assert found == {i: [350, 29] for i in IDS}
    assert (bench.now_s() - before_s) * 1e3 == pytest.approx(807.0, abs=0.5)


def test_broadcast_ping_is_met_with_silence_in_protocol_1() -> None:
    bench = robot_bench(AX)
    assert bench.send(b"\xff\xff\xfe\x02\x01\xfe") == b""


def test_instant_profile_takes_no_time_at_all() -> None:
    for model in (AX, XL):
        bench = robot_bench(model, "instant")
        assert bench.ms(lambda b=bench: b.get("present_position")) == 0.0


# -- profile files ------------------------------------------------------------------------------


def test_shipped_profiles_parse_and_say_their_source() -> None:
    assert set(profiles()) >= {"ideal", "instant", "thesis-marvin", "thesis-phantomx", "ftdi-16ms"}
    for name in profiles():
        profile = load_profile(name)
        assert profile.name == name
        assert profile.source


def test_ideal_profile_file_is_the_profile_without_any_time() -> None:
    assert replace(load_profile("ideal"), source="") == IDEAL
    assert {f.default for f in fields(Profile) if f.name.endswith("_s")} == {0.0}


@pytest.mark.parametrize(
    ("text", "key", "rule"),
    [
        ("hots_out_s = 1e-3", "hots_out_s", "unknown key"),
        ("host_out_s = -1e-3", "host_out_s", "at least 0"),
        ('host_out_s = "1 ms"', "host_out_s", "must be a number"),
        ("host_out_s = true", "host_out_s", "must be a number"),
        ("host_out_s = nan", "host_out_s", "must be a number"),
        ("host_out_s = inf", "host_out_s", "must be a number"),
        ("bits_per_byte = 0", "bits_per_byte", "at least 1"),
        ("bits_per_byte = 9.5", "bits_per_byte", "whole"),
        ('instant = "no"', "instant", "true or false"),
        ("latency_timer_s = 0.016", "latency_timer_s", "chunk_bytes"),
        ("interrupt_busy_s = 2.0\ninterrupt_period_s = 1.0", "interrupt_busy_s", "longer"),
        ("host_out_s 1", "", "not a TOML file"),
        ("", "source", "empty"),
    ],
)
def test_profile_file_is_refused_with_file_key_and_rule(
    tmp_path: Path, text: str, key: str, rule: str
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(ProfileError) as caught:
        load_profile(path)
    message = str(caught.value)
    assert str(path) in message
    assert key in message
    assert rule in message
    assert "\n" not in message


def test_unknown_profile_name_lists_the_known_ones() -> None:
    with pytest.raises(ProfileError, match=r"no timing profile named 'fast': .*thesis-marvin"):
        load_profile("fast")


def test_profile_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="cannot be read"):
        load_profile(tmp_path / "nothing.toml")
