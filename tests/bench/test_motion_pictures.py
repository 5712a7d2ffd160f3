"""What the picture of a recording's motion shows of goals."""

import numpy as np
import pytest
from odd_joints import joint, recording

from bench.figures.recording import motion_figure

GOAL = ("goal_position", "write")


def goal_line(columns):
    (axes,) = motion_figure(recording(columns)).axes
    (line,) = (one for one in axes.lines if one.get_label() == "goal")
    return line.get_xdata(), line.get_ydata()


@pytest.mark.parametrize(("off_s", "until_s"), [(None, 5.984), (4.0, 4.0), (0.5, 5.984)])
def test_the_last_goal_is_drawn_for_as_long_as_it_was_in_force(off_s, until_s):
    columns = joint()
    times, raw = columns[GOAL]
    columns[GOAL] = times[:100], raw[:100]  # 2 s
    if off_s is not None:
        columns["torque_enable", "write"] = np.array([off_s]), np.array([0.0])
    t, y = goal_line(columns)
    assert t[-1] == pytest.approx(until_s)
    assert t[-2] == pytest.approx(times[99])
    assert y[-1] == y[-2]


def test_torque_that_is_switched_on_ends_no_goal():
    columns = joint() | {("torque_enable", "write"): (np.array([5.99]), np.array([1.0]))}
    assert goal_line(columns)[0][-1] == pytest.approx(5.99)
