"""Legged robots in the hidden world: masses, forces, and the seam behind the bus."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from bench.blind import (
    Asked,
    drafts,
    legged_case,
    legged_sizing,
    open_key,
    open_truth,
    rerun,
    write_case,
)
from bench.blind.drives import Drives, Electrics
from bench.blind.legged import Body, document, said
from bench.blind.legged_effects import LEGGED, Where, Whole
from bench.blind.legs import GRAVITY_M_S2, LegsPlant
from bench.blind.scenes import LEG, OBSERVE_S, POSTURE, SCENES, Group, Plan, Scene, play
from bench.motions import ExperimentPlan, WalkPlan, motion
from bench.recording import read
from busemu.plant import DriveCommand
from busemu.tables import load_robot

SECRET = "a secret that is long enough"
Floats = NDArray[np.float64]
ROBOTS = ("marvin", "phantomx")


@pytest.mark.parametrize("name", ROBOTS)
def test_robot_weighs_what_its_file_says(name: str) -> None:
    robot = load_robot(name)
    file = robot.document
    links = sum(said(file, "link", link, "mass_kg") for link in POSTURE)
    trunk = said(file, "trunk", "mass_kg") + said(file, "trunk", "battery_kg")
    for body in (Body(), Body(foot_n_m={"leg2": 2000.0})):
        model = mujoco.MjModel.from_xml_string(document(robot, body))
        assert model.body_mass.sum() == pytest.approx(trunk + 6 * links, rel=1e-4)


def standing(body: Body) -> LegsPlant:
    """Marvin after it stood up and took a step or two."""
    return play(SCENES["marvin-walk"], WalkPlan(seconds=0.5), body, Electrics()).plant


def test_feet_carry_the_weight_and_a_soft_floor_gives_by_it() -> None:
    stiffness = 4000.0
    plant = standing(Body(ground_n_m=stiffness))
    for _ in range(600):  # the torque is off: it sinks and lies still
        plant.advance(plant.now_s + 2e-3)
    weight_n = GRAVITY_M_S2 * (float(plant.model.body_mass.sum()) - 3.0)
    assert -stiffness * plant.data.joint("floor").qpos[0] == pytest.approx(weight_n, rel=0.02)


def test_a_leg_stands_while_its_foot_carries() -> None:
    plant = standing(Body())
    stands = plant.stands.reshape(6, 3)
    assert (stands.any(axis=1) == stands.all(axis=1)).all()  # a leg with all its joints
    forces = plant.observe()
    loaded = [forces[f"contact/leg{n}_n"] > 0.0 for n in range(1, 7)]
    assert stands[:, 0].tolist() == loaded
    assert any(loaded)
    held = LegsPlant(load_robot("marvin"), Body(support="suspended", legs=(LEG,)))
    assert not held.stands.any()


def test_the_share_in_stance_is_of_squares_while_walking() -> None:
    before, after = (round(s / OBSERVE_S) for s in (legged_sizing.BEGINNING_S, legged_sizing.END_S))
    count = before + 10 + after
    still = legged_sizing.Track(np.zeros((count, 2)), np.tile([True, False], (count, 1)))
    angle = np.full((count, 2), 7.0)  # standing up and lying down do not count
    angle[before : before + 10] = [2.0, 1.0]
    moved = legged_sizing.Track(angle, ~still.stands)
    assert legged_sizing.standing_share([still], [moved]) == pytest.approx(4 / 5)


def test_the_size_of_a_walk_is_without_standing_up(monkeypatch: pytest.MonkeyPatch) -> None:
    before, after = (round(s / OBSERVE_S) for s in (legged_sizing.BEGINNING_S, legged_sizing.END_S))
    still = legged_sizing.Track(np.zeros((before + 10 + after, 2)), np.zeros((1, 2), dtype=bool))
    angle = np.full_like(still.angle_rad, 7.0)
    angle[before : before + 10] = 3.0
    moved = legged_sizing.Track(angle, still.stands)
    monkeypatch.setattr(legged_sizing, "base", lambda _: [still])
    monkeypatch.setattr(legged_sizing, "_with", lambda *_: [moved])
    monkeypatch.setattr(legged_sizing, "legged_floor", lambda _: 2.0)
    where = Where(1, ())
    assert legged_sizing.walking_ratio("a walk", "payload", 1.0, where) == pytest.approx(1.5)
    hidden = legged_case.LeggedHidden("payload", 1.0, 3.0, 3.0, where)
    disguise = legged_case.LeggedHidden("gain_error", 0.1, math.nan, math.nan, where)
    assert hidden.walking(SCENES["marvin-walk"]) == pytest.approx(1.5)
    assert hidden.walking(SCENES["marvin-leg"]) is None
    assert disguise.walking(SCENES["marvin-walk"]) is None


@pytest.mark.slow
def test_standing_up_is_over_where_the_share_in_stance_begins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = SCENES["phantomx-walk"]
    whole = legged_sizing.believed(scene)
    changed, _ = LEGGED["gain_error"].apply(
        whole, 0.1, Where(-1, tuple(f"leg{n}" for n in range(1, 7)))
    )
    one = legged_sizing.base(scene.name)
    two = legged_sizing.tracks(scene, {"straight": changed})
    share = legged_sizing.standing_share(one, two)
    monkeypatch.setattr(legged_sizing, "BEGINNING_S", legged_sizing.BEGINNING_S + 1.0)
    later = legged_sizing.standing_share(one, two)
    assert share == pytest.approx(later, abs=0.05)  # slipping feet of its start would give 0.50


@pytest.mark.slow
def test_soft_tips_move_joints_that_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    walk = (Group("straight", WalkPlan(seconds=2.5)),)
    scene = Scene("short-walk", "marvin", "ground", walk, (), ("straight",))
    monkeypatch.setattr(legged_sizing, "SCENES", {scene.name: scene})
    effect = LEGGED["foot_compliance"]
    hidden = legged_case.LeggedHidden(effect.name, 1 / 300, 3.0, 3.0, Where(1, ("leg2", "leg5")))
    share = legged_case.stance_share(scene, [hidden])
    assert share is not None
    assert 2 / 3 < share <= 1.0
    assert hidden.joints == tuple(f"leg{n}.{link}" for n in (2, 5) for link in POSTURE)
    assert legged_case.stance_share(scene, []) is None
    assert legged_case.stance_share(SCENES["marvin-leg"], [hidden]) is None


def test_loaded_femur_on_a_stand_has_the_torque_of_its_weight() -> None:
    scene = SCENES["marvin-leg"]
    robot = scene.robot
    plant = LegsPlant(robot, Body(support="suspended", legs=scene.legs))
    # friction would share the load
    plant.model.dof_frictionloss[:] = 0.0
    held = {f"{LEG}.coxa": 0.0, f"{LEG}.femur": 0.3, f"{LEG}.tibia": -0.6}
    for joint, angle in held.items():
        mount = robot.by_joint[joint]
        goal = mount.to_servo(angle)
        order = DriveCommand(
            True, goal_position_rad=goal, gain_cw_per_rad=5.0, gain_ccw_per_rad=5.0
        )
        plant.command(mount.servo_id, order)
    plant.advance(3.0)
    mujoco.mj_forward(plant.model, plant.data)
    hip = plant.data.joint(f"{LEG}.femur").xanchor
    moment = 0.0
    for body in (f"{LEG}.femur", f"{LEG}.tibia"):
        out = plant.data.body(body).xipos[:2] - hip[:2]
        moment += float(plant.model.body(body).mass[0]) * float(np.hypot(*out))
    state = plant.sample(robot.by_joint[f"{LEG}.femur"].servo_id)
    step_nm = 5.0 * 0.39 * said(robot.document, "drive", "XL-320", "sensor_step_rad")
    assert abs(state.torque_nm) == pytest.approx(GRAVITY_M_S2 * moment, abs=step_nm)


def test_how_often_it_is_advanced_changes_nothing() -> None:
    robot = load_robot("marvin")
    ends = []
    for steps in (1, 7, 400):
        plant = LegsPlant(robot)
        plant.command(5, DriveCommand(True, goal_position_rad=-1.5, gain_ccw_per_rad=5.0))
        for k in range(steps):
            plant.advance(0.4 * (k + 1) / steps)
            plant.sample(5)
        ends.append(plant.sample(5))
    assert ends[0] == ends[1] == ends[2]
    with pytest.raises(ValueError, match="cannot go back"):
        plant.advance(0.1)
    with pytest.raises(KeyError):
        plant.sample(99)


def test_play_and_spring_add_up_at_the_sensor() -> None:
    joint = f"{LEG}.tibia"
    body = Body(support="suspended", legs=(LEG,), play_rad={joint: 0.04})
    plant = LegsPlant(load_robot("marvin"), body)
    data = plant.data
    parts = [float(data.joint(name).qpos[0]) for name in (joint, f"{joint}/twist", f"{joint}/play")]
    plant.advance(0.5)
    parts = [float(data.joint(name).qpos[0]) for name in (joint, f"{joint}/twist", f"{joint}/play")]
    assert abs(parts[2]) == pytest.approx(0.02, rel=0.1)  # it hangs at one end of its play
    mount = plant._robot.by_joint[joint]
    assert plant.sample(mount.servo_id).position_rad == pytest.approx(mount.to_servo(sum(parts)))


@cache
def as_believed(name: str) -> tuple[Plan, Whole, Floats]:
    """A short plan of a scene, the robot in it as it is believed to be, and its trace."""
    plan: Plan = WalkPlan(seconds=1.6)
    if name == "marvin-leg":
        fast = motion("steps", amplitude_rad=0.45, center_rad=0.5, duration_s=1.2)
        plan = ExperimentPlan(fast, joint=f"{LEG}.femur")
    base = legged_sizing.believed(SCENES[name], plan)
    return plan, base, play(SCENES[name], plan, base.body, base.electrics).track_rad


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=() if n == "foot_compliance" else pytest.mark.slow) for n in LEGGED],
)
def test_legged_effect_moves_the_trace(name: str) -> None:
    effect = LEGGED[name]
    scene = SCENES["marvin-leg" if effect.standing else "marvin-walk"]
    plan, base, still = as_believed(scene.name)
    legs = tuple(leg["name"] for leg in scene.robot.document["leg"])
    size = 0.5 * (effect.typical + effect.most)
    changed, truth = effect.apply(base, size, Where(1, legs))
    moved = play(scene, plan, changed.body, changed.electrics).track_rad
    n = min(len(still), len(moved))
    step_rad = next(iter(scene.robot.tables.values()))["present_position"].si_scale
    assert np.abs(still[:n] - moved[:n]).max() > step_rad
    assert all(q.value != q.off or key == "roll_rad" for key, q in truth.items())


def test_nothing_changed_is_the_believed_robot() -> None:
    robot = load_robot("marvin")
    assert Whole(robot, Body(), Electrics()).body_but().body == Body()
    neutral = Body(link_mass={"tibia": 1.0}, twist_nm_rad={}, play_rad={}, foot_n_m={})
    assert document(robot, neutral) == document(robot, Body())


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> Scene:
    """A leg on a stand with two short groups."""
    moves = [
        Group(
            name,
            ExperimentPlan(
                motion("dither", amplitude_rad=0.3, center_rad=center, duration_s=1.0),
                joint=f"{LEG}.{link}",
            ),
            repeats=1,
        )
        for name, link, center in (("femur", "femur", 0.5), ("tibia-held-out", "tibia", -1.2))
    ]
    held_out = ("tibia-held-out",)
    scene = Scene("short-leg", "marvin", "suspended", tuple(moves), held_out, ("femur",))
    for module in (legged_case, legged_sizing, drafts):
        monkeypatch.setattr(module, "SCENES", {scene.name: scene})
    return scene


def test_leg_case_is_sealed_like_any_other(short: Scene, tmp_path: Path) -> None:
    wish = Asked(kind="null", rig=short.name, disguise=True)
    folder = write_case(tmp_path / "leg", 5, SECRET, wish)
    again = write_case(tmp_path / "again", 5, SECRET, wish)
    key = open_key(folder, SECRET)
    assert key["effects"] == []
    assert [abs(v) for v in key["decoy_rad"].values()] == [pytest.approx(math.radians(2.0))]
    names = sorted(path.name for path in (folder / "recordings").iterdir())
    assert names == ["femur-01.parquet", "tibia-held-out-01.parquet"]
    for name in names:
        one, two = (f / "recordings" / name for f in (folder, again))
        assert one.read_bytes() == two.read_bytes()
    assert (folder / "robot.toml").read_bytes() == short.robot.path.read_bytes()
    recording = read(folder / "recordings" / names[0])
    assert recording.metadata["source"] == "simulation"
    truth = open_truth(folder, SECRET)
    mine = np.array([n == "femur-01" for n in truth.column("recording").to_pylist()])
    rows = truth.column("row").to_numpy()[mine]
    servo = truth.column("servo_id").to_numpy()[mine]
    raw = recording.table.column("raw").to_numpy()[rows]
    angle = truth.column("position_rad").to_numpy()[mine]
    register = recording.register(1, "present_position")
    shown = np.array([register.to_si(int(r)) for r in raw])
    assert set(servo) == {1, 3, 5}
    assert np.abs(shown - angle).max() <= 0.5 * register.si_scale + 1e-9


def test_leg_case_can_be_run_again_but_cannot_walk(short: Scene, tmp_path: Path) -> None:
    folder = write_case(tmp_path / "leg", 5, SECRET, Asked(kind="null", rig=short.name))
    plan = ExperimentPlan(motion("hold", center_rad=0.5, duration_s=0.5), joint=f"{LEG}.femur")
    assert rerun(folder, SECRET, plan).metadata["condition"]["joint"] == f"{LEG}.femur"
    with pytest.raises(ValueError, match="neither stands nor walks"):
        rerun(folder, SECRET, WalkPlan())


def test_wishes_that_a_scene_cannot_grant_are_refused() -> None:
    with pytest.raises(ValueError, match="marvin-leg cannot hide foot_slip"):
        legged_case.draw_legged(
            1, Asked(kind="single", effects=("foot_slip",), rig="marvin-leg", concealment="plain")
        )
    with pytest.raises(ValueError, match="strangers are hidden on one-joint rigs"):
        legged_case.draw_legged(1, Asked(kind="stranger", rig="marvin-leg"))
    with pytest.raises(ValueError, match="not mimicked"):
        legged_case.draw_legged(1, Asked(kind="single", concealment="mimicked", rig="marvin-leg"))


@pytest.mark.parametrize("name", ["marvin", "phantomx"])
def test_no_servo_pushes_at_the_count_of_its_goal(name: str) -> None:
    """Goals are counts of a table, and what a sensor shows is counts of the file's rounded step."""
    robot = load_robot(name)
    joint = f"{LEG}.femur"
    goal = robot.tables[robot.by_joint[joint].servo_id]["goal_position"]
    drives = Drives(robot, [joint], Electrics())
    for count in range(0, 1024, 31):
        at_rad = goal.to_si(count)
        order = DriveCommand(
            True,
            goal_position_rad=at_rad,
            gain_ccw_per_rad=5.0,
            gain_cw_per_rad=5.0,
            punch_duty=0.1,
        )
        drives.order(0, order)
        drives.tick(np.array([at_rad]), np.zeros(1), 0.0)
        assert drives.duty.tolist() == [0.0]
        drives.tick(np.array([goal.to_si(count + 1)]), np.zeros(1), 0.0)
        assert drives.duty[0] < -0.1
