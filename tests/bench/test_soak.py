"""A short soak, and that a soak sees what it is there to see."""

from __future__ import annotations

import pytest

from bench import soak as soaking
from bench.soak import soak
from bench.soak_rigs import VirtualRig
from busemu.tables import load_robot

MARVIN = load_robot("marvin")


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything that befalls the bus within a few seconds."""
    monkeypatch.setattr(soaking, "TROUBLE_EVERY_S", 1.0)
    monkeypatch.setattr(soaking, "CLEAR_EVERY_S", 4.0)
    monkeypatch.setattr(soaking, "PATIENCE_S", 2.0)


def run(seconds: float, rig: VirtualRig | None = None):
    told: list[float] = []
    found = soak(rig or VirtualRig(MARVIN, "ideal"), MARVIN, seconds, told.append)
    assert told[-1] >= seconds
    return found


def test_a_short_soak_finds_nothing_wrong_and_everything_struck():
    found = run(12.0)
    assert (found.exceptions, found.silent) == (0, 0)
    assert found.drift_s == pytest.approx(0.0, abs=1e-9)
    assert found.drift_end_s == pytest.approx(0.0, abs=1e-9)
    assert found.struck > 50
    assert found.lost > 0
    assert found.replugs > 0
    assert len(found.memory_kib) == len(soaking.MARKS)
    assert found.transactions > 100


def test_a_soak_is_the_same_every_time_but_for_its_own_time_and_memory():
    found = [run(3.0) for _ in range(2)]
    same = [(each.transactions, each.lost, each.struck, each.bus_s) for each in found]
    assert same[0] == same[1]


def test_an_error_of_another_kind_is_counted(monkeypatch, capsys):
    def broken(*_: object) -> int:
        raise ValueError("broken")

    monkeypatch.setattr(soaking, "_cycle", broken)
    found = run(1.0)
    assert found.exceptions > 0
    assert capsys.readouterr().err.count("ValueError: broken") == 1


def test_joints_that_fall_behind_are_seen(monkeypatch):
    rig = VirtualRig(MARVIN, "ideal")
    monkeypatch.setattr(rig._plant, "advance", lambda to_s: None)
    assert run(0.5, rig).drift_s > 0.1


def test_a_servo_that_stays_silent_is_seen(monkeypatch):
    rig = VirtualRig(MARVIN, "ideal")
    monkeypatch.setattr(rig.faults, "clear", lambda *_: 0)
    rig.faults.dead(servo=3)
    assert run(1.0, rig).silent >= 1
