"""Whatever faults, whatever bytes: nothing raises, nothing grows, and the bus lives on."""

from __future__ import annotations

import random

import pytest
from fault_bench import FaultBench
from hypothesis import given, settings
from hypothesis import strategies as st
from test_hostile_bytes import INSTRUCTIONS, encoded, hostile
from virtual_bus import AX, OK, XL, small_robot

from busemu.faults import Kind, load_scenario, parse_fault
from busemu.faults.fault import KEYS, MOST_S

BOTH = pytest.mark.parametrize("model", [AX, XL])
VALUES = {
    "servo": st.one_of(st.integers(1, 3), st.lists(st.integers(1, 3), max_size=3)),
    "after_s": st.floats(0.0, 0.3),
    "for_s": st.floats(0.0, 0.3),
    "register": st.sampled_from(["id", "present_position", "goal_position"]),
    "instruction": st.sampled_from(["ping", "read", "write", "sync_read", "fast_sync_read"]),
    "count": st.integers(1, 5),
    "probability": st.floats(0.0, 1.0),
    "on": st.sampled_from(["reply", "instruction"]),
    "bits": st.integers(1, 40),
    "bytes": st.integers(1, 40),
    "delay_s": st.floats(0.0, 0.2),
    "gap_s": st.floats(0.0, 0.2),
    "temperature_c": st.floats(0.0, 120.0),
    "id": st.integers(1, 9),
}


@st.composite
def faults(draw):
    kind = draw(st.sampled_from(list(Kind)))
    fields = {"kind": kind.value}
    for key in KEYS[kind]:
        if draw(st.booleans()) or (kind is Kind.DUPLICATE_ID and key in ("servo", "id")):
            fields[key] = draw(VALUES[key])
    if kind is Kind.DUPLICATE_ID:
        fields["servo"] = draw(st.integers(1, 3))
    return fields


packets = st.tuples(
    st.sampled_from([1, 2, 3, 9, 254]),
    st.sampled_from(INSTRUCTIONS),
    st.binary(max_size=40).map(lambda b: b"\x19\x00" + b),
)
steps = st.lists(
    st.one_of(faults(), st.binary(max_size=60), packets, st.floats(0.0, 0.2)), max_size=25
)


def assert_answers(bench: FaultBench) -> None:
    """With all faults cleared, each servo that has an ID of its own answers at its baud rate."""
    bench.clear()
    bench.sleep(MOST_S)
    bench.port.openPort()
    bus = bench.bus
    assert bus.next_reply_s() is None
    assert len(bus.agenda) <= 2 * len(bus.servos) + 2
    ids = [servo.servo_id for servo in bus.servos]
    for servo in bus.servos:
        if ids.count(servo.servo_id) == 1 and servo.servo_id < 253:
            bench.port.setBaudRate(servo.baud_rate)
            bus.receive(b"\x00", bench.now_s())
            bench.sleep(0.2)
            assert bench.instruct(1, servo_id=servo.servo_id) is not None


@BOTH
@pytest.mark.parametrize("profile", ["ideal", "instant", "ftdi-16ms"])
@settings(max_examples=60, deadline=None)
@given(steps=steps, seed=st.integers(0, 9))
def test_any_faults_and_any_bytes_are_survived(model, profile, steps, seed):
    bench = FaultBench(small_robot(model), profile=profile, seed=seed)
    for step in steps:
        if isinstance(step, dict):
            bench.have(**step)
        elif isinstance(step, float):
            bench.sleep(step)
        else:
            bench.send(encoded(model, step), then_s=0.0)
    assert_answers(bench)


@BOTH
@settings(max_examples=25, deadline=None)
@given(asked=st.lists(faults(), min_size=1, max_size=6), seed=st.integers(0, 9))
def test_the_same_faults_seed_and_traffic_give_the_same_bytes(model, asked, seed):
    runs = []
    for _ in range(2):
        bench = FaultBench(model, profile="ftdi-16ms", seed=seed)
        for fields in asked:
            bench.have(**fields)
        chance = random.Random(seed)
        answers = [bench.send(hostile(model, chance), then_s=0.02) for _ in range(20)]
        runs.append((answers, bench.wire, [bench.image(i) for i in range(3)]))
    assert runs[0] == runs[1]


@BOTH
def test_a_long_run_of_faults_holds_no_more_than_a_short_one(model, tmp_path):
    path = tmp_path / "all.toml"
    rows = [
        f'[[fault]]\nkind = "{kind.value}"\nprobability = 0.05\n'
        for kind, keys in KEYS.items()
        if "probability" in keys
    ]
    path.write_text('format = "busemu-faults/1"\n' + "".join(rows), "utf-8")
    bench = FaultBench(model, profile="ftdi-16ms")
    bench.bus.on_wire = None
    for fault in load_scenario(path, bench.robot).faults:
        bench.faults.add(fault)
    worst = []
    for _ in range(2):
        most = 0
        for round_ in range(1500):
            bench.read("present_position", 1 + round_ % 3)
            if round_ % 10 == 0:
                fault = parse_fault(
                    {"kind": "dead", "servo": 1, "for_s": 0.01}, "test", bench.robot
                )
                bench.faults.add(fault)
            most = max(most, len(bench.bus.agenda) + bench.bus.hearing.held)
        worst.append(most)
    assert worst[1] <= worst[0] + 5
    assert bench.bus.hearing.held <= 1031
    assert len(bench.faults.standing()) <= 256
    assert_answers(bench)


def test_a_bus_that_was_given_no_fault_asks_none():
    bench = FaultBench(XL)
    bench.look()
    assert bench.bus.faults is None
    bench.have("drop", count=1)
    assert bench.bus.faults is bench.faults
    assert bench.look()[1] != OK
