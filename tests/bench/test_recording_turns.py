"""When servos looked that were read together, as far as a host's notes tell."""

from math import nan
from types import SimpleNamespace

import numpy as np
import pytest

from bench.recording import Recording
from bench.recording.turns import TURN
from bench.running import in_process
from busemu.plant import IdealPlant, ideal
from busemu.tables import load_robot
from busemu.timing import load_profile
from hal.robot_control import RobotControl

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
        assert waits.own == pytest.approx([TURN * 0.001])
        assert waits.first == pytest.approx([TURN * 0.001])


def test_after_replies_of_their_own_instants_the_line_and_the_host_take_the_same_of_all():
    told = recording([row(0.0, k, 0.001 * k) for k in SERVOS])
    for servo in SERVOS:
        waits = told.waits(servo, "present_position")
        assert waits.own == pytest.approx([0.001 * servo - (1.0 - TURN) * 0.003])
        assert waits.first == pytest.approx([0.001 - (1.0 - TURN) * 0.003])


def test_replies_that_come_in_blocks_are_of_servos_at_even_distances():
    """Four servos, handed over two by two."""
    noted = [0.0014, 0.0014, 0.0026, 0.0026]
    rows = [row(t, k, t + noted[k]) for t in (0.0, 0.02, 0.04) for k in range(4)]
    rows += [row(0.06, k, 0.065 + noted[k]) for k in range(4)]  # a hiccup before the first
    told = recording(rows)
    every = np.array([own(told, k) for k in range(4)])
    steps = np.diff(every, axis=0)
    assert steps == pytest.approx(np.full((3, 4), steps[0, 0]))
    assert 0.0004 < steps[0, 0] < 0.0006
    assert every[0, 3] - every[0, 0] == pytest.approx(0.005 * TURN)
    few = recording([row(0.0, k, noted[2 * k]) for k in range(2)])
    assert own(few, 1) - own(few, 0) == pytest.approx([0.0012])


class Watched(IdealPlant):
    """A plant that knows when it was asked."""

    now_s = 0.0

    def advance(self, to_s):
        self.now_s = to_s
        super().advance(to_s)

    def sample(self, servo_id):
        self.asked.append((servo_id, self.now_s))
        return super().sample(servo_id)


def test_what_is_told_of_a_sync_read_is_when_the_emulated_servos_look():
    robot = load_robot("marvin")
    plant = ideal(robot)
    plant.__class__, plant.asked = Watched, []
    session = in_process(robot, plant, load_profile(robot.timing))
    control = RobotControl(robot, session.client, tuple(robot.by_joint))
    control.read_positions()
    plant.asked.clear()
    for _ in range(4):
        control.read_positions()
    told = session.recording("reads", "reads")
    off = []
    for mount in robot.servos:
        times = told.series(mount.servo_id, "present_position", "read").t_sample_s[1:]
        looked = times + own(told, mount.servo_id)[1:]
        real = np.array([t for servo, t in plant.asked if servo == mount.servo_id])
        near = real[np.abs(real[:, None] - looked).argmin(axis=0)]
        off += (looked - near).tolist()
    assert len(off) == 4 * 18
    assert np.std(off) < 0.1e-3
    assert abs(np.mean(off)) < 0.8e-3


def test_of_a_packets_end_for_all_each_has_its_share_in_turn():
    rows = [row(0.02 * k, servo, 0.02 * k + END_S) for k in range(3) for servo in SERVOS]
    told = recording(rows)
    for place, servo in enumerate(SERVOS):
        waits = told.waits(servo, "present_position")
        assert waits.own == pytest.approx(np.full(3, TURN * END_S * (place + 1) / 3))
        assert waits.first == pytest.approx(np.full(3, TURN * END_S / 3))


def test_a_reply_that_is_lost_makes_nobody_elses_later():
    """The host waits for it, and notes that for those that had answered."""
    whole = [row(0.1 * k, servo, 0.1 * k + END_S) for k in range(3) for servo in SERVOS]
    lost = [row(0.3, 1, 0.3 + LATE_S), row(0.3, 2, 0.3 + LATE_S), row(0.3, 3, nan, nan)]
    told = recording([*whole, *lost])
    assert own(told, 1) == pytest.approx(np.full(4, TURN * END_S / 3))
    assert own(told, 2) == pytest.approx(np.full(4, TURN * END_S * 2 / 3))
    assert len(own(told, 3)) == 3


def test_writes_of_the_same_instant_and_other_registers_are_no_turns():
    rows = [row(0.0, 1, nan, op="write", register="goal_position"), row(0.0, 1, 0.001)]
    rows.append(row(0.0, 1, 0.001, register="present_load"))
    told = recording(rows)
    assert own(told, 1) == pytest.approx([TURN * 0.001])


def test_where_no_reply_was_noted_there_is_none():
    told = recording([row(0.0, servo, nan) for servo in SERVOS])
    assert np.isnan(own(told, 2)).all()
