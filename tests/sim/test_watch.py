"""What is noticed: falls, self-contacts, links on the ground; by name and time."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from sim_rigs import LAWS, hold, stand

from busemu.plant import DriveCommand
from busemu.tables import Robot, load_robot
from sim.scene import Push, Scene
from sim.watch import APART_S, LEANING_RAD, STOOD_S, WATCH_S, Contacts, Event, Watch, What
from sim.world import BulletPlant

Make = Callable[..., BulletPlant]
LYING = Contacts({"trunk": 5.0})
CLEAR = Contacts({"leg1.tibia": 5.0})


def watched(*looks: tuple[Contacts, float, float, bool]) -> list[Event]:
    """Events of what holds (contacts, lean) for so long [s], with torque on or not."""
    watch = Watch(frozenset({"leg1.tibia", "leg2.tibia"}))
    step = 0
    for contacts, lean, lasts_s, powered in looks:
        for _ in range(round(lasts_s / WATCH_S)):
            step += 1
            watch.look(step * WATCH_S, contacts, lean, powered)
    return watch.events


def falls(events: list[Event]) -> list[float]:
    return [event.t_s for event in events if event.what is What.FALL]


def test_touching_the_ground_after_standing_is_a_fall() -> None:
    events = watched(
        (LYING, 0.0, 0.5, True), (CLEAR, 0.0, STOOD_S + 0.1, True), (LYING, 0.0, 0.2, True)
    )
    assert falls(events) == [pytest.approx(0.5 + STOOD_S + 0.1 + WATCH_S)]


def test_bouncing_while_standing_up_is_no_fall() -> None:
    assert not falls(
        watched((LYING, 0.0, 0.5, True), (CLEAR, 0.0, 0.1, True), (LYING, 0.0, 0.2, True))
    )


def test_lying_down_with_the_torque_off_is_no_fall() -> None:
    assert not falls(watched((CLEAR, 0.0, 1.0, True), (LYING, 0.0, 1.0, False)))


def test_leaning_too_far_is_a_fall_and_is_told_once() -> None:
    beyond = LEANING_RAD + 0.01
    events = watched(
        (CLEAR, 0.0, 1.0, True), (CLEAR, beyond, 1.0, True), (LYING, beyond, 1.0, True)
    )
    assert len(falls(events)) == 1
    assert "leans by 46 deg" in str(next(e for e in events if e.what is What.FALL))


def test_who_stands_again_can_fall_again() -> None:
    upright, fallen = (CLEAR, 0.0, STOOD_S + 0.1, True), (LYING, 0.0, 0.3, True)
    assert len(falls(watched(upright, fallen, upright, fallen))) == 2
    shortly = (CLEAR, 0.0, STOOD_S / 2, True)
    assert len(falls(watched(upright, fallen, shortly, fallen))) == 1


def test_what_touches_at_first_and_what_chatters_is_no_event() -> None:
    pair = Contacts({}, {("leg1.tibia", "leg5.tibia"): 1.0})
    apart = (Contacts(), 0.0, APART_S / 2, True)
    assert watched((pair, 0.0, 0.1, True), apart, (pair, 0.0, 0.1, True)) == []
    long_apart = (Contacts(), 0.0, APART_S + 0.1, True)
    (event,) = watched((pair, 0.0, 0.1, True), long_apart, (pair, 0.0, 0.1, True))
    assert (event.what, event.bodies) == (What.SELF_CONTACT, ("leg1.tibia", "leg5.tibia"))


def test_feet_on_the_ground_are_no_event_and_other_links_are() -> None:
    knee = Contacts({"leg1.tibia": 1.0, "leg2.femur": 0.5})
    (event,) = watched((Contacts(), 0.0, 0.2, True), (knee, 0.0, 0.2, True))
    assert str(event) == "0.22 s: ground contact: leg2.femur"


def test_links_on_the_ground_of_a_robot_without_torque_are_no_event() -> None:
    belly = Contacts({"trunk": 5.0, "leg2.femur": 0.5})
    assert watched((Contacts(), 0.0, 0.2, False), (belly, 0.0, 0.2, False)) == []
    still = (belly, 0.0, 0.2, True)  # nor when its torque comes on
    assert watched((Contacts(), 0.0, 0.2, False), (belly, 0.0, 0.2, False), still) == []


def test_a_robot_that_is_pushed_over_has_fallen(robot: Robot, make: Make) -> None:
    weight_n = 9.81 * (0.756 if robot.name == "marvin" else 2.418)
    push = Push(4.0, 0.3, (3.0 * weight_n, 0.0, weight_n), "trunk", (0.0, 0.0, 0.05))
    plant = make(robot, scene=Scene(pushes=(push,)))
    stand(plant, robot, 4.0)
    assert plant.events == []
    plant.advance(5.0)
    fall = next(event for event in plant.events if event.what is What.FALL)
    assert 4.0 < fall.t_s < 4.5
    assert fall.bodies == ("trunk",)


def test_standing_up_and_letting_go_is_no_fall(robot: Robot, make: Make) -> None:
    plant = make(robot)
    stand(plant, robot, 4.0)
    for servo in robot.servos:
        plant.command(servo.servo_id, DriveCommand())
    plant.advance(6.0)
    assert plant.observe()["contact/trunk_n"] > 0.0
    assert not falls(list(plant.events))


def test_a_self_contact_is_named_by_pair_in_events_and_observations(make: Make) -> None:
    robot = load_robot("marvin")
    plant = make(robot, held=True)
    hold(plant, robot, {"coxa": 0.0, "femur": 0.0, "tibia": -0.5})
    plant.advance(1.0)
    assert plant.events == []
    for leg, angle in (("leg1", 1.0), ("leg5", -1.0)):
        servo = robot.by_joint[f"{leg}.coxa"]
        law = DriveCommand(
            torque_enable=True, goal_position_rad=servo.to_servo(angle), **LAWS["marvin"]
        )
        plant.command(servo.servo_id, law)
    pairs: dict[str, float] = {}
    for step in range(100):
        plant.advance(1.0 + 0.01 * (step + 1))
        seen = plant.observe()
        own = {key: force for key, force in seen.items() if key.startswith("contact/self/")}
        assert sum(own.values()) == pytest.approx(seen["contact/self_n"])
        pairs |= own
    touched = {event.bodies for event in plant.events if event.what is What.SELF_CONTACT}
    assert touched
    assert touched <= {tuple(key.removesuffix("_n").split("/")[2:]) for key in pairs}
    assert all({body.split(".")[0] for body in pair} == {"leg1", "leg5"} for pair in touched)
    assert all(event.t_s > 1.0 for event in plant.events)
