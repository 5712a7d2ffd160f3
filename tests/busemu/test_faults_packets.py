"""What each fault of packets does to the unmodified SDK, in virtual time."""

from __future__ import annotations

import pytest
from fault_bench import FaultBench
from virtual_bus import AX, CHECKSUM_1, CORRUPT, CRC_2, OK, TIMEOUT, XL, Bench, small_robot

from busemu.ports.sdk import SDK_MARGIN_MS
from busemu.trace import WireEventKind

BOTH = pytest.mark.parametrize("model", [AX, XL])


def traffic(bench: Bench) -> list[object]:
    """What a program might do, and all that it sees."""
    seen: list[object] = []
    for round_ in range(20):
        seen.append(bench.write("goal_position", 400 + round_, 1 + round_ % 3))
        seen += [bench.read("present_position", servo_id) for servo_id in (1, 2, 3)]
        if bench.two:
            seen.append(bench.sync_read("present_position", (1, 2, 3)))
        bench.sleep(0.01)
    return seen


@BOTH
def test_a_fault_that_never_strikes_leaves_every_byte_and_instant(model):
    without, struck = Bench(model, profile="ftdi-16ms"), FaultBench(model, profile="ftdi-16ms")
    struck.have("corrupt", probability=0.0)
    struck.have("drop", servo=2, after_s=1e6)
    assert traffic(without) == traffic(struck)
    assert without.wire == struck.wire
    assert without.now_s() == struck.now_s()


@BOTH
def test_dropped_replies_time_out_as_often_as_was_asked(model):
    bench = FaultBench(model)
    bench.have("drop", servo=2, count=2)
    assert [bench.look(2)[1] for _ in range(3)] == [TIMEOUT, TIMEOUT, OK]
    assert bench.words == ["drop: reply of servo 2 to read"] * 2


@BOTH
def test_a_dropped_reply_is_that_of_an_instruction_carried_out(model):
    bench = FaultBench(model)
    bench.have("drop", servo=1)
    assert bench.write("goal_position", 300)[0] == TIMEOUT
    assert bench.memory("goal_position") == 300


@BOTH
def test_a_dropped_instruction_is_not_carried_out(model):
    bench = FaultBench(model)
    before = bench.memory("goal_position")
    bench.have("drop", servo=1, on="instruction", count=1)
    assert bench.write("goal_position", 300)[0] == TIMEOUT
    assert bench.memory("goal_position") == before
    assert bench.words == ["drop: instruction write"]
    bench.set("goal_position", 300)


@pytest.mark.parametrize("profile", ["ideal", "instant"])
def test_a_dropped_reply_silences_those_after_it_in_a_sync_read(profile):
    bench = FaultBench(XL, profile=profile)
    bench.have("drop", servo=2, count=1)
    assert bench.sync_read("present_position", (1, 2, 3))[0] == TIMEOUT
    assert len(bench.replies()) == 1
    assert bench.sync_read("present_position", (1, 2, 3))[0] == OK


@pytest.mark.parametrize("kind", ["drop", "truncate"])
def test_a_fast_read_breaks_off_where_a_fault_strikes(kind):
    model = "XL430-W250"
    whole, struck = FaultBench(small_robot(model)), FaultBench(small_robot(model))
    struck.have(kind, servo=2)
    request = struck.packet(0x8A, (132, 0, 4, 0, 1, 2, 3), 254)
    all_of_it, part = whole.send(request), struck.send(request)
    assert all_of_it.startswith(part)
    first_block = 8 + 1 + 1 + 4 + 2  # up to its CRC
    if kind == "drop":
        assert len(part) == first_block
    else:
        assert first_block < len(part) < first_block + 8


@BOTH
@pytest.mark.parametrize("bits", [1, 5])
def test_a_corrupt_reply_is_never_taken_for_a_good_one(model, bits):
    bench = FaultBench(model)
    bench.get("present_position")
    good = bench.replies()
    bench.have("corrupt", servo=1, bits=bits)
    for _ in range(50):
        bench.wire.clear()
        result = bench.read("present_position")[1]
        (reply,) = bench.replies()
        assert reply not in good
        if bits == 1:
            assert result in (TIMEOUT, CORRUPT)
    bench.clear()
    bench.sleep(0.2)
    assert bench.look()[1] == OK


@BOTH
def test_servos_answer_an_instruction_whose_parameters_were_damaged_with_their_checksum_error(
    model,
):
    """One bit of the packet flips; where the header stays whole the servo sees a wrong checksum."""
    bench = FaultBench(model)
    bench.have("corrupt", on="instruction", servo=1)
    errors = set()
    for _ in range(60):
        errors.add(bench.write("goal_position", 300)[1])
        bench.sleep(0.2)
    assert (CHECKSUM_1 if model == AX else CRC_2) in errors
    assert bench.memory("goal_position") != 300


@BOTH
def test_a_truncated_reply_is_shorter_by_what_was_asked(model):
    bench = FaultBench(model)
    bench.look()
    (whole,) = bench.replies()
    bench.have("truncate", bytes=3, count=1)
    assert bench.look()[1] in (TIMEOUT, CORRUPT)
    assert bench.replies()[1] == whole[:3]
    assert bench.look()[1] == OK


@BOTH
def test_a_truncated_instruction_swallows_the_next_one_until_the_inter_byte_timeout(model):
    bench = FaultBench(model)
    bench.have("truncate", on="instruction", instruction="sync_write", bytes=8, count=1)
    bench.sync_write(30, {i: bytes(2) for i in (1, 2, 3)})
    bench.sleep(0.01)  # longer than 1.5 ms (Protocol 2.0), shorter than 100 ms (1.0)
    assert bench.look()[1] == (TIMEOUT if model == AX else OK)
    bench.sleep(0.2)
    assert bench.look()[1] == OK


@BOTH
def test_a_delay_moves_the_reply_by_exactly_itself(model):
    plain, late = FaultBench(model), FaultBench(model)
    late.have("delay", delay_s=0.0125)
    assert late.ms(late.look) - plain.ms(plain.look) == pytest.approx(12.5)


@BOTH
def test_a_reply_delayed_beyond_the_timeout_is_lost_and_does_no_harm_later(model):
    bench = FaultBench(model, profile="ftdi-16ms")
    bench.have("delay", delay_s=0.1, count=1)
    assert bench.look(1)[1] == TIMEOUT
    for _ in range(10):
        assert bench.look(2)[1] in (OK, TIMEOUT, CORRUPT)
    assert bench.look(2)[1] == OK
    starts = [event.start_s for event in bench.wire if event.kind is not WireEventKind.FAULT]
    assert starts == sorted(starts)


def test_a_delayed_servo_of_a_sync_read_delays_those_after_it():
    plain, late = FaultBench(XL), FaultBench(XL)
    late.have("delay", servo=2, delay_s=0.004)
    request = plain.packet(0x82, (37, 0, 2, 0, 1, 2, 3), 254)
    plain.send(request)
    late.send(request)
    starts = [
        [event.start_s for event in bench.wire if event.kind is WireEventKind.STATUS]
        for bench in (plain, late)
    ]
    assert [b - a for a, b in zip(*starts, strict=True)] == pytest.approx([0.0, 0.004, 0.004])
    assert [event.start_s for event in late.wire] == sorted(event.start_s for event in late.wire)


@BOTH
@pytest.mark.parametrize("profile", ["ideal", "instant"])
def test_a_split_reply_has_a_pause_and_is_still_read(model, profile):
    bench = FaultBench(model, profile=profile)
    value = bench.get("present_position")
    (whole,) = bench.replies()
    bench.wire.clear()
    bench.have("split", gap_s=0.010)
    assert bench.get("present_position") == value
    first, second = (event for event in bench.wire if event.kind is WireEventKind.STATUS)
    assert first.data + second.data == whole
    assert second.start_s - first.end_s == pytest.approx(0.010)


@BOTH
def test_a_duplicated_reply_comes_twice(model):
    bench = FaultBench(model)
    whole = bench.send(bench.packet(1))
    bench.have("duplicate", count=1)
    assert bench.send(bench.packet(1)) == 2 * whole
    assert bench.look()[1] == OK


@BOTH
def test_noise_before_a_reply_is_read_over_and_before_an_instruction_too(model):
    bench = FaultBench(model)
    whole = bench.send(bench.packet(1))
    bench.have("noise", bytes=6, count=1)
    answer = bench.send(bench.packet(1))
    assert len(answer) == 6 + len(whole)
    assert answer.endswith(whole)
    bench.have("noise", on="instruction", bytes=6)
    assert bench.send(bench.packet(1)) == whole
    assert bench.bus.counts.noise_bytes > 0


@BOTH
def test_a_latency_spike_leaves_the_wire_alone_and_the_host_waiting(model):
    bench, plain = FaultBench(model), FaultBench(model)
    bench.have("latency", delay_s=0.020, count=1)
    assert bench.ms(bench.look) - plain.ms(plain.look) == pytest.approx(20.0)
    status = [[e for e in b.wire if e.kind is WireEventKind.STATUS] for b in (bench, plain)]
    assert status[0] == status[1]


@BOTH
@pytest.mark.parametrize("profile", ["ideal", "ftdi-16ms", "instant"])
def test_replies_keep_their_order_behind_a_latency_spike(model, profile):
    bench = FaultBench(model, profile=profile) if profile != "ideal" else FaultBench(model)
    bench.have("latency", delay_s=0.2, count=1)
    answers = b""
    for servo_id in (1, 2, 3):
        answers += bench.send(bench.packet(1, servo_id=servo_id), then_s=0.05)
    assert answers == b""
    answers += bench.sleep(0.3)
    at = [answers.index(reply) for reply in bench.replies()]
    assert at == sorted(at)
    assert len(answers) == sum(map(len, bench.replies()))


@BOTH
def test_a_fault_strikes_only_its_servo_instruction_register_and_time(model):
    bench = FaultBench(model)
    bench.have(
        "drop",
        servo=[2, 3],
        instruction="read",
        register="present_position",
        after_s=1.0,
        for_s=1.0,
    )

    def answers(name="present_position", servo_id=2):
        return bench.read(name, servo_id)[1] == OK

    assert answers()
    bench.clock.sleep_until(1.1)
    assert not answers()
    assert not answers(servo_id=3)
    assert answers(servo_id=1)
    assert answers("goal_position")
    assert bench.write("goal_position", 500, 2) == (OK, 0)
    bench.clock.sleep_until(2.1)
    assert answers()


@BOTH
def test_an_instruction_is_struck_alone(model):
    bench = FaultBench(model)
    bench.have("drop", instruction="write")
    assert bench.look()[1] == OK
    assert bench.write("goal_position", 500)[0] == TIMEOUT


@BOTH
def test_a_refusal_of_a_packet_that_nobody_could_read_answers_no_instruction(model):
    bench = FaultBench(model)
    bench.have("drop", instruction="read", after_s=0.01)
    assert bench.look()[1] == OK
    bench.sleep(0.01)
    damaged = bytearray(bench.packet(2, (3, 1) if model == AX else (7, 0, 1, 0)))
    damaged[-1] ^= 1
    assert bench.send(bytes(damaged))
    assert bench.words == []


def test_a_register_beside_the_one_that_is_read_is_not_touched():
    bench = FaultBench(XL)
    bench.have("drop", register="goal_position")
    place = bench.table["goal_position"]
    for address in (place.address - 1, place.address + place.size):
        assert bench.sdk.readTxRx(bench.port, 1, address, 1)[1] == OK
    for address in range(place.address, place.address + place.size):
        assert bench.sdk.readTxRx(bench.port, 1, address, 1)[1] == TIMEOUT


def test_a_register_is_found_in_a_read_of_a_whole_block():
    bench = FaultBench(XL)
    bench.have("drop", register="present_position")
    assert bench.sdk.readTxRx(bench.port, 1, 30, 20)[1] == TIMEOUT
    assert bench.sdk.readTxRx(bench.port, 1, 0, 20)[1] == OK
    assert bench.sync_read("present_position", (1, 2))[0] == TIMEOUT
    assert bench.sync_read("present_voltage", (1, 2))[0] == OK


def test_a_lost_sync_write_leaves_all_goals_alone():
    bench = FaultBench(XL)
    bench.have("drop", on="instruction", instruction="sync_write", servo=2, count=1)
    goals = {i: (300).to_bytes(2, "little") for i in (1, 2, 3)}
    before = [bench.memory("goal_position", i) for i in range(3)]
    bench.sync_write(30, goals)
    assert [bench.memory("goal_position", i) for i in range(3)] == before
    bench.sync_write(30, goals)
    bench.sleep(0.01)
    assert [bench.memory("goal_position", i) for i in range(3)] == [300] * 3


def test_a_probability_is_about_the_share_that_is_struck():
    bench = FaultBench(XL)
    bench.have("drop", probability=0.25)
    lost = sum(bench.look(1 + i % 3)[1] != OK for i in range(400))
    assert 70 < lost < 130  # four standard deviations of a binomial are 35


@BOTH
def test_the_same_seed_and_traffic_give_the_same_bytes_and_another_seed_others(model):
    runs = []
    for seed in (1, 1, 2):
        bench = FaultBench(model, profile="ftdi-16ms", seed=seed)
        bench.have("drop", probability=0.1)
        bench.have("corrupt", probability=0.2, bits=2)
        bench.have("noise", probability=0.2)
        bench.have("latency", probability=0.1)
        seen = traffic(bench)
        runs.append((seen, bench.wire, bench.now_s()))
    assert runs[0] == runs[1]
    assert runs[0][1] != runs[2][1]


def test_one_more_fault_does_not_change_what_the_others_draw():
    struck = []
    for more in (False, True):
        bench = FaultBench(XL)
        bench.have("drop", servo=1, probability=0.5)
        if more:
            bench.have("drop", servo=2, probability=0.5)
        struck.append([(bench.look(1)[1], bench.look(2)[1]) for _ in range(40)])
    assert [a for a, _ in struck[0]] == [a for a, _ in struck[1]]
    assert any(b != OK for _, b in struck[1])


def test_a_fault_that_struck_is_told_once_with_its_instant_and_its_words():
    bench = FaultBench(XL)
    bench.have("delay", servo=1, delay_s=0.01, count=1)
    bench.get("present_position")
    (fault,) = (event for event in bench.wire if event.kind is WireEventKind.FAULT)
    assert fault.words == "delay: reply of servo 1 to read: 10 ms late on the wire"
    assert fault.data == b""
    assert bench.faults.standing()[0].state == "over"
    assert bench.faults.standing()[0].struck == 1


def test_the_sdk_waits_as_long_for_a_dropped_reply_as_for_an_absent_servo():
    bench = FaultBench(XL)
    bench.have("drop")
    assert bench.ms(bench.look) == pytest.approx(SDK_MARGIN_MS, abs=1.0)
