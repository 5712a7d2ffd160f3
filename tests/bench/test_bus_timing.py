"""Timing a bus through the robot's own client."""

import pytest

from bench.bus_timing import TRIES, time_bus
from bench.running import in_process
from busemu.plant import ideal
from busemu.tables import load_robot
from busemu.timing import load_profile
from hal.bus_errors import CorruptReplyError, NoReplyError

TIMEOUT_S = 0.02
MARVIN = load_robot("marvin")


def session():
    return in_process(MARVIN, ideal(MARVIN), load_profile(MARVIN.timing))


def failing(session, name, monkeypatch, times, error):
    """Have a client's call fail so often, after a timeout, before it does what it should."""
    client, clock = session.client, session.clock
    call, left = getattr(client, name), [times]

    def instead(*arguments):
        left[0] -= 1
        if left[0] >= 0:
            clock.sleep_until(clock.now_s() + TIMEOUT_S)
            raise error(1, "lost on the way")
        return call(*arguments)

    monkeypatch.setattr(client, name, instead)


@pytest.mark.parametrize("name", ["ping", "read", "write"])
@pytest.mark.parametrize("error", [NoReplyError, CorruptReplyError])
@pytest.mark.parametrize("lost", [1, TRIES - 1])
def test_a_lost_reply_is_asked_for_again_and_not_timed(monkeypatch, name, error, lost):
    whole, hurt = session(), session()
    failing(hurt, name, monkeypatch, lost, error)
    times = [{t.kind: t.times_s.tolist() for t in time_bus(one, 3)} for one in (whole, hurt)]
    assert times[1].keys() == times[0].keys()
    for kind, expected_s in times[0].items():
        assert times[1][kind] == pytest.approx(expected_s, abs=1e-9)


def test_a_mute_servo_is_an_error(monkeypatch):
    mute = session()
    failing(mute, "ping", monkeypatch, TRIES, NoReplyError)
    with pytest.raises(NoReplyError, match="lost on the way"):
        time_bus(mute, 3)
