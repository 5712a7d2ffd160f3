"""Joint angles to registers and back, against the tables' own conversion."""

import numpy as np
import pytest
from hal_doubles import FakeClient, FakeClock

from busemu.tables import load_robot
from hal.robot_control import GoalRangeError, RobotControl


def make(name, joints=None):
    robot = load_robot(name)
    client = FakeClient(list(robot.by_id), robot.servos[0].model, FakeClock())
    return RobotControl(robot, client, joints), client, robot


@pytest.mark.parametrize("name", ["phantomx", "marvin"])
def test_goals_are_rounded_as_the_tables_round(name):
    control, client, robot = make(name)
    rng = np.random.default_rng(0)
    for _ in range(100):
        goals = rng.uniform(control.lower_rad, control.upper_rad)
        control.set_goals(goals)
        sent = client.calls[-1][1]
        for joint, goal in zip(control.joints, goals, strict=True):
            mount = robot.by_joint[joint]
            register = robot.tables[mount.servo_id]["goal_position"]
            assert sent[mount.servo_id] == register.from_si(mount.to_servo(goal))


@pytest.mark.parametrize("name", ["phantomx", "marvin"])
def test_positions_come_back_within_half_a_count(name):
    control, _, _ = make(name)
    goals = np.random.default_rng(1).uniform(control.lower_rad, control.upper_rad)
    control.set_goals(goals)
    assert control.read_positions() == pytest.approx(goals, abs=0.5 * np.radians(0.29296875) + 1e-9)


def test_a_goal_out_of_range_names_the_joint_and_sends_nothing():
    control, client, _ = make("marvin")
    goals = np.clip(np.zeros(18), control.lower_rad, control.upper_rad)
    goals[7] = 5.0
    with pytest.raises(GoalRangeError, match=rf"{control.joints[7]}: goal 5\.0000 rad is outside"):
        control.set_goals(goals)
    with pytest.raises(GoalRangeError, match=r"leg2\.tibia"):
        control.set_goals({"leg2.tibia": float("nan")})
    assert not client.calls


def test_goals_by_name_go_to_those_joints_only():
    control, client, _ = make("phantomx")
    control.set_goals({"leg6.tibia": -1.0, "leg1.coxa": 0.1})
    assert set(client.calls[-1][1]) == {18, 1}
    assert client.calls[-1][1][18] == 512 + round(1.0 / np.radians(0.29296875))  # mounted reversed


def test_a_lost_reply_is_nan():
    control, client, robot = make("phantomx")
    client.mute = {robot.by_joint["leg3.femur"].servo_id}
    lost = np.isnan(control.read_positions())
    assert [j for j, is_lost in zip(control.joints, lost, strict=True) if is_lost] == ["leg3.femur"]


def test_the_order_of_joints_can_be_chosen():
    control, _, _ = make("marvin", ("leg2.coxa", "leg1.femur"))
    control.set_goals([0.3, 1.2])
    assert control.ids == (2, 3)
    assert control.read_positions() == pytest.approx([0.3, 1.2], abs=0.003)
    with pytest.raises(KeyError, match=r"leg9\.coxa"):
        make("marvin", ("leg9.coxa",))


def test_torque_off_names_the_joints_that_did_not_confirm_and_tries_again():
    control, client, robot = make("marvin")
    control.torque_on()
    assert control.torque_off() == ()
    mute = robot.by_joint["leg5.coxa"].servo_id
    client.mute = {mute}
    client.calls.clear()
    assert control.torque_off() == ("leg5.coxa",)
    assert [len(values) for _, values in client.calls] == [18, 1, 1]
    client.dead_port = True
    assert control.torque_off() == control.joints


def test_alerts_are_told_in_words_by_joint():
    control, client, robot = make("marvin")
    femur = robot.by_joint["leg5.femur"].servo_id
    client.statistics.alert_bits[femur] = 0x80
    client.registers[femur]["hardware_error_status"] = 1
    assert control.alerts() == {"leg5.femur": "overload error"}
    control, client, robot = make("phantomx")
    client.statistics.alert_bits[1] = 0x24
    assert control.alerts() == {"leg1.coxa": "overheating error, overload error"}
