"""The walk in virtual time: it lets go whatever happens, and counts what it should."""

from itertools import pairwise

import numpy as np
import pytest
from hal_doubles import FakeClient, FakeClock

from busemu.tables import load_robot
from hal.bus_errors import NoReplyError, PortLostError
from hal.cpg import LocomotionController
from hal.legs import UnreachableError
from hal.robot_control import RobotControl
from hal.walk import BusSilentError, JointSilentError, WalkInterrupted, walk

STAND_UP_READS = 80  # more reads than the first look and the standing up take


def make(name="phantomx", seed=1):
    robot = load_robot(name)
    clock = FakeClock()
    client = FakeClient(list(robot.by_id), robot.servos[0].model, clock)
    controller = LocomotionController.of(robot, seed)
    # The servos' power-on posture: joints within their range.
    control = RobotControl(robot, client, controller.joints)
    return control, controller, clock, client


def torque_is_off(client):
    return all(registers["torque_enable"] == 0 for registers in client.registers.values())


@pytest.mark.parametrize("name", ["phantomx", "marvin"])
def test_a_walk_keeps_its_cycle_and_ends_with_the_torque_off(name):
    control, controller, clock, client = make(name)
    told = []
    report = walk(control, controller, clock, 5.0, cycle_s=0.020, progress=told.append)
    assert report.cycles == 250
    assert report.cycle_mean_s == pytest.approx(0.020)
    assert report.cycle_max_s == pytest.approx(0.020)
    assert report.missed_deadlines == report.lost_replies == report.clipped_goals == 0
    assert report.torque_left_on == ()
    assert torque_is_off(client)
    assert len(told) == 250
    assert told == sorted(told)
    assert told[-1] == pytest.approx(5.0)
    assert max(report.tracking_rms_rad.values()) < 0.003  # rounding only: these servos are ideal


def test_without_a_word_the_cycle_is_the_robot_files():
    control, controller, clock, _ = make()
    report = walk(control, controller, clock, 1.0)
    assert report.cycle_mean_s == pytest.approx(controller.gait.cycle_s)


def test_goals_go_out_before_the_torque_and_start_where_the_joints_are():
    control, controller, clock, client = make()
    walk(control, controller, clock, 0.1)
    names = [register for register, _ in client.calls]
    assert names[:3] == ["moving_speed", "goal_position", "torque_enable"]
    assert set(client.calls[1][1].values()) == {512}
    assert client.calls[2][1] == dict.fromkeys(client.registers, 1)


def test_standing_up_is_slow_and_ends_in_the_neutral_posture():
    control, controller, clock, client = make()
    began_s = clock.t_s
    walk(control, controller, clock, 0.0)
    assert clock.t_s - began_s > 1.5
    goals = [values for register, values in client.calls if register == "goal_position"]
    steps = [max(abs(b[i] - a[i]) for i in a) for a, b in pairwise(goals)]
    assert max(steps) < 15  # counts a cycle: 4.4 degrees in 20 ms
    assert control.read_positions() == pytest.approx(controller.neutral_rad, abs=0.003)


@pytest.mark.parametrize("name", ["phantomx", "marvin"])
@pytest.mark.parametrize("seed", range(5))
def test_the_first_step_begins_near_the_neutral_posture_and_no_goal_leaps(name, seed):
    control, controller, clock, client = make(name, seed)
    walk(control, controller, clock, 6.0)
    goals = [values for register, values in client.calls if register == "goal_position"]
    steps = [max(abs(b[i] - a[i]) for i in a) for a, b in pairwise(goals)]
    assert max(steps) < 35  # counts a cycle: 9 rad/s


def test_cycles_that_overrun_are_counted_and_not_caught_up_with():
    control, controller, clock, client = make()
    client.read_s = [0.019] * STAND_UP_READS
    plain = walk(control, controller, clock, 2.0, cycle_s=0.020)
    assert plain.missed_deadlines == 0
    control, controller, clock, client = make()
    client.read_s = [0.019] * 100 + [0.05, 0.019, 0.03]
    report = walk(control, controller, clock, 2.0, cycle_s=0.020)
    assert report.missed_deadlines == 2
    assert report.cycle_max_s == pytest.approx(0.05)
    assert report.cycle_median_s == pytest.approx(0.020)
    assert report.cycles == 98  # 0.05 + 0.03 + 96 * 0.02


def test_without_a_period_the_bus_sets_the_pace():
    control, controller, clock, _ = make()
    report = walk(control, controller, clock, 1.0, cycle_s=0.0)
    assert report.cycle_mean_s == pytest.approx(0.019)
    assert report.missed_deadlines == 0


@pytest.mark.parametrize("after", [1, 40, STAND_UP_READS + 10])
def test_ctrl_c_switches_the_torque_off_and_brings_the_report(after):
    control, controller, clock, client = make()
    client.on_read = [None] * after + [KeyboardInterrupt()]
    with pytest.raises(KeyboardInterrupt) as caught:
        walk(control, controller, clock, 5.0)
    assert isinstance(caught.value, WalkInterrupted)
    assert caught.value.report.torque_left_on == ()
    assert torque_is_off(client)
    assert client.calls[-1][0] == "torque_enable"


def test_any_exception_switches_the_torque_off():
    control, controller, clock, client = make()

    def progress(elapsed_s):
        if elapsed_s > 0.5:
            raise RuntimeError("the progress bar broke")

    with pytest.raises(RuntimeError, match="broke"):
        walk(control, controller, clock, 5.0, progress=progress)
    assert torque_is_off(client)
    control, controller, clock, client = make()
    client.on_read = [None] * 50 + [NoReplyError(3, "read")]
    with pytest.raises(NoReplyError):
        walk(control, controller, clock, 5.0)
    assert torque_is_off(client)


def test_a_port_that_is_lost_says_which_joints_may_still_be_on():
    control, controller, clock, client = make()

    def progress(elapsed_s):
        client.dead_port = elapsed_s > 0.5

    with pytest.raises(PortLostError) as caught:
        walk(control, controller, clock, 5.0, progress=progress)
    assert "leg3.femur" in caught.value.__notes__[0]
    assert "cut the supply" in caught.value.__notes__[0]


def test_a_bus_gone_silent_ends_the_walk():
    control, controller, clock, client = make()

    def progress(elapsed_s):
        if elapsed_s > 0.5:
            client.mute = set(client.registers)

    with pytest.raises(BusSilentError, match="3 cycles"):
        walk(control, controller, clock, 5.0, progress=progress)


def test_one_mute_servo_is_counted_and_does_not_end_the_walk():
    control, controller, clock, client = make()

    def progress(elapsed_s):
        client.mute = {7} if elapsed_s < 0.51 else set()

    report = walk(control, controller, clock, 1.0, cycle_s=0.020, progress=progress)
    assert report.lost_replies == 25
    assert report.errors == {"no reply": 25}
    assert torque_is_off(client)


def test_a_joint_that_is_silent_at_the_start_is_named_and_nothing_is_switched_on():
    control, controller, clock, client = make()
    client.mute = {11}
    with pytest.raises(JointSilentError, match=r"no reply from leg3\.tibia \(servo 11\)"):
        walk(control, controller, clock, 1.0)
    assert not client.calls


def test_goals_beyond_a_joint_are_held_and_counted():
    control, controller, clock, _ = make()
    index = control.joints.index("leg5.coxa")
    control.upper_rad = control.upper_rad.copy()
    control.upper_rad[index] = 0.02
    report = walk(control, controller, clock, 4.0)
    assert report.clipped_goals > 10
    assert control.read_positions()[index] < 0.03


def test_too_long_a_stride_is_refused_before_anything_moves():
    control, controller, clock, client = make()
    with pytest.raises(UnreachableError):
        walk(control, controller, clock, 1.0, v_left=30.0, v_right=30.0)
    assert not client.calls


def test_steering_may_follow_the_time():
    control, controller, clock, client = make()
    asked = []

    def steer(t_s):
        asked.append(t_s)
        return (0.0, 0.0)

    walk(control, controller, clock, 1.0, steer=steer, cycle_s=0.020)
    assert asked[0] == 0.0
    assert len(asked) == 50
    goals = [v for r, v in client.calls if r == "goal_position"][-40:]
    coxa = [g[1] for g in goals]
    assert np.ptp(coxa) <= 1  # no stride: the legs only lift


def test_a_control_with_other_joints_is_refused():
    control, controller, clock, client = make()
    other = RobotControl(control.robot, client, control.joints[::-1])
    with pytest.raises(ValueError, match="joints"):
        walk(other, controller, clock, 1.0)
