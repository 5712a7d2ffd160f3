"""The fuzzer: the same bytes for the same seed, and it finds what is planted."""

from __future__ import annotations

import pytest

from bench.fuzz import BUSES, FuzzError, run
from busemu.servo import Servo

COUNT = 20_000


def test_the_same_seed_sends_the_same_bytes_to_every_kind_of_bus() -> None:
    one, two = run(COUNT, 7), run(COUNT, 7)
    assert one == two
    assert one.bytes_sent >= COUNT
    assert {new[0] for new in one.news} == {model for model, _ in BUSES}
    assert one.replies > 0
    assert one.pings > 0
    assert run(COUNT, 8) != one


def test_an_exception_in_a_servo_is_found_and_its_burst_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(servo: Servo, parameters: bytes) -> None:
        raise IndexError("planted")

    monkeypatch.setattr(Servo, "_clear", broken)
    with pytest.raises(FuzzError, match=r"IndexError: planted; burst [0-9a-f]+$"):
        run(COUNT * 10, 7)


def test_a_servo_that_does_not_answer_its_ping_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Servo, "answers", lambda servo, instruction: False)
    with pytest.raises(FuzzError, match="answers a ping with"):
        run(COUNT, 7)
