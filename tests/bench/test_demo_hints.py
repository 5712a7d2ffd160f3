"""What the demo says of a machine that was too busy to measure."""

import numpy as np
import pytest

from bench.bus_timing import Timed
from bench.demo import SLOW, hindered

MODEL = [
    Timed(kind, kind, np.full(5, time_s))
    for kind, time_s in (("read one", 0.003), ("write all", 0.001))
]


def measured(factor, kind="read one"):
    return [Timed(m.kind, m.what, m.times_s * (factor if m.kind == kind else 1.0)) for m in MODEL]


def test_an_idle_machine_is_not_spoken_of():
    assert hindered(measured(0.99 * SLOW), MODEL, 0) == []


@pytest.mark.parametrize(
    ("factor", "late", "says"),
    [
        (1.0, 1, "1 reply was lost and asked for again: the machine is busy"),
        (1.0, 3, "3 replies were lost and asked for again: the machine is busy"),
        (1.01 * SLOW, 0, "1 of 2 kinds of transaction took too long: the machine is busy"),
        (9.0, 3, "asked for again, 1 of 2 kinds"),
    ],
)
def test_lost_replies_and_long_times_are_told_with_what_to_do(factor, late, says):
    (hint,) = hindered(measured(factor), MODEL, late)
    assert says in hint
    assert "nothing else running" in hint


def test_a_write_that_nobody_waits_for_tells_nothing():
    assert hindered(measured(50.0, "write all"), MODEL, 0) == []
