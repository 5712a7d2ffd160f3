"""When servos that are read together answered, as far as a host noted it."""

from math import nan
from types import SimpleNamespace

import numpy as np
import pytest

from bench.recording import Recording

END_S = 0.012  #: of a sync read's last reply
LATE_S = 0.036  #: where one reply is lost, and the host gives up
SERVOS = (1, 2, 3)


def row(t_s, servo, reply_s, raw=512.0, register="present_position", op="read"):
    return SimpleNamespace(
        t_s=t_s, t_reply_s=reply_s, servo_id=servo, op=op, register=register, raw=raw
    )


def recording(rows):
    return Recording.of(rows, {"name": "turns", "robot": "marvin", "source": "real"})


def own(told, servo):
    return told.waits(servo, "present_position").own


def test_a_servo_that_is_read_alone_has_the_wait_that_was_noted():
    told = recording([row(0.01 * k, k, 0.01 * k + 0.001) for k in SERVOS])
    for servo in SERVOS:
        waits = told.waits(servo, "present_position")
        assert waits.own == pytest.approx([0.001])
        assert waits.first == pytest.approx([0.001])


def test_replies_of_their_own_instants_are_as_they_were_noted():
    told = recording([row(0.0, k, 0.001 * k) for k in SERVOS])
    for servo in SERVOS:
        waits = told.waits(servo, "present_position")
        assert waits.own == pytest.approx([0.001 * servo])
        assert waits.first == pytest.approx([0.001])


def test_of_a_packets_end_for_all_each_has_its_share_in_turn():
    rows = [row(0.02 * k, servo, 0.02 * k + END_S) for k in range(3) for servo in SERVOS]
    told = recording(rows)
    for place, servo in enumerate(SERVOS):
        waits = told.waits(servo, "present_position")
        assert waits.own == pytest.approx(np.full(3, END_S * (place + 1) / 3))
        assert waits.first == pytest.approx(np.full(3, END_S / 3))


def test_a_reply_that_is_lost_makes_nobody_elses_later():
    """The host waits for it, and notes that for those that had answered."""
    whole = [row(0.1 * k, servo, 0.1 * k + END_S) for k in range(3) for servo in SERVOS]
    lost = [row(0.3, 1, 0.3 + LATE_S), row(0.3, 2, 0.3 + LATE_S), row(0.3, 3, nan, nan)]
    told = recording([*whole, *lost])
    assert own(told, 1) == pytest.approx(np.full(4, END_S / 3))
    assert own(told, 2) == pytest.approx(np.full(4, END_S * 2 / 3))
    assert len(own(told, 3)) == 3


def test_writes_of_the_same_instant_and_other_registers_are_no_turns():
    rows = [row(0.0, 1, nan, op="write", register="goal_position"), row(0.0, 1, 0.001)]
    rows.append(row(0.0, 1, 0.001, register="present_load"))
    told = recording(rows)
    assert own(told, 1) == pytest.approx([0.001])


def test_where_no_reply_was_noted_there_is_none():
    told = recording([row(0.0, servo, nan) for servo in SERVOS])
    assert np.isnan(own(told, 2)).all()
