"""Arms of several joints: each joint by itself, under the recorded posture of the others."""

import json
from dataclasses import replace
from datetime import date
from math import nan
from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.joint.diagnosis import JointFindings
from bench.diagnosis.joint.model import Hypothesis, JointModel
from bench.diagnosis.joint.together import together
from bench.diagnosis.knobs import effect_knobs, joint_effects
from bench.diagnosis.observed import observe
from bench.diagnosis.posture import arm_load, recorded_posture
from bench.diagnosis.running import DiagnosisError, Split, diagnose, write
from bench.recording import Recording, RecordingError
from busemu.tables import load_robot
from sim.effects import effect
from sim.model import additions, read_model
from sim.posture import posture_load
from sim.rollout import Batch

ROBOT = load_robot("arm")
ARM = read_model(ROBOT)
MOVING = ("shoulder", "elbow")  #: the base stands still
SPEEDS_RAD_S = (3.0, 5.0, 7.0, 9.0)
STEP_S, DURATION_S = 0.02, 2.0
REST_S = 0.2  #: at the beginning
SIZE = 2.0  #: of the elbow's delay, in typical sizes


def goals(speed):
    """Joint angles (n, joints) that an arm is told, in the order of its servos."""
    t = np.arange(0.0, DURATION_S, STEP_S)
    wave = np.sin(speed * np.maximum(0.0, t - REST_S))
    by_joint = {"base": 0.0 * t, "shoulder": 0.8 + 0.3 * wave, "elbow": -0.5 + 0.4 * wave}
    return np.stack([by_joint[joint.name] for joint in ARM.joints], axis=1)


def recording(number, goal, seen, silent=()):
    """A recording of goals and positions, joint angles (n, joints)."""
    rows = []
    for k, (wanted, angles) in enumerate(zip(goal.tolist(), seen.tolist(), strict=True)):
        for i, mount in enumerate(ROBOT.servos):
            t_s = k * STEP_S
            rows.append(access(mount, t_s, "write", "goal_position", wanted[i]))
            if mount.joint not in silent:
                rows.append(access(mount, t_s + 0.002, "read", "present_position", angles[i]))
    metadata = {"name": f"wave-{number}", "group": f"wave-{number}", "robot": "arm"}
    return Recording.of(rows, metadata | {"condition": {"support": "rig"}})


def access(mount, t_s, op, name, joint_rad):
    register = ROBOT.tables[mount.servo_id][name]
    raw = register.encode(register.from_si(mount.to_servo(joint_rad)))
    reply = t_s + 0.001 if op == "read" else nan
    return SimpleNamespace(
        t_s=t_s, t_reply_s=reply, servo_id=mount.servo_id, op=op, register=name, raw=raw
    )


def waves():
    """Recordings of an arm whose elbow gets its goals later than its file says."""
    told = [goals(speed) for speed in SPEEDS_RAD_S]
    seen = [goal.copy() for goal in told]
    knobs = effect_knobs(effect("transport_delay"))
    for column, joint in enumerate(ARM.joints):
        if joint.name not in MOVING:
            continue
        drafts = [recording(i, g, s) for i, (g, s) in enumerate(zip(told, seen, strict=True))]
        observed = observe(drafts, ROBOT, joint.name)
        model = JointModel(ARM, ROBOT, observed)
        own = knobs if joint.name == "elbow" else ()
        z = np.array([*np.zeros(len(model.nuisances)), *(SIZE for _ in own)])
        candidates = [model.candidate(Hypothesis(own), z, r) for r in range(len(drafts))]
        outs = Batch([o.replay for o in observed]).run(candidates, range(len(drafts)))
        for angles, out in zip(seen, outs, strict=True):
            angles[:, column] = [ROBOT.by_joint[joint.name].to_joint(q) for q in out[:, 0].tolist()]
    return [recording(i, g, s) for i, (g, s) in enumerate(zip(told, seen, strict=True))]


@pytest.fixture(scope="module")
def found():
    recordings = waves()
    parts = Split(tuple(recordings[:3]), tuple(recordings[3:]))
    without = [name for name in joint_effects() if name not in ("transport_delay", "com_offset")]
    told = []
    return SimpleNamespace(
        findings=diagnose(ROBOT, parts, without=without, say=told.append), told=told
    )


def test_the_load_of_a_servo_is_that_of_its_joint_seen_from_the_servo():
    posture = np.random.default_rng(3).uniform(-1.0, 1.0, (5, len(ARM.joints)))
    for mount in ROBOT.servos:
        turned = replace(mount, direction=-1, zero_rad=0.7)
        load, joint = arm_load(ARM, turned, posture), posture_load(ARM, mount.joint, posture)
        for servo_rad in (-1.0, 0.0, 0.4):
            there = np.full(5, turned.to_joint(servo_rad))
            seen = load.cosine_nm * np.cos(servo_rad) - load.sine_nm * np.sin(servo_rad)
            assert seen == pytest.approx(turned.direction * joint.torque_nm(there), abs=1e-12)


def test_an_arm_that_moves_pulls_a_servo_where_it_was_recorded():
    """By what its joint is pulled, beside gravity, the way the servo turns."""
    span_s = 0.6
    t_s = np.linspace(0.0, span_s, 61)[:, None]
    posture = 0.5 * np.sin(np.array([[5.0, 7.0, 9.0]]) * t_s)
    for mount in ROBOT.servos:
        turned = replace(mount, direction=-1, zero_rad=0.7)
        moves = posture_load(ARM, mount.joint, posture, 0.01).moved_nm
        assert np.abs(moves).max() > 1e-3
        own = posture[:, [j.name for j in ARM.joints].index(mount.joint)]
        servo_rad = np.array([turned.to_servo(angle) for angle in own])
        pulled, still = (
            load.cosine_nm * np.cos(servo_rad) - load.sine_nm * np.sin(servo_rad)
            for load in (arm_load(ARM, turned, posture, s) for s in (span_s, None))
        )
        assert pulled - still == pytest.approx(turned.direction * moves, abs=1e-12)


def test_an_arm_in_one_posture_stands_still_however_long():
    """As it does in experiments that nobody has made yet."""
    posture = np.array([[0.1, 0.8, -0.5]])
    for mount in ROBOT.servos:
        for_long, for_ever = (arm_load(ARM, mount, posture, s) for s in (6.0, None))
        assert for_long.cosine_nm == pytest.approx(for_ever.cosine_nm)
        assert for_long.sine_nm == pytest.approx(for_ever.sine_nm)


def test_the_recorded_posture_is_in_joint_angles():
    goal = goals(3.0)
    posture = recorded_posture(recording(0, goal, goal), ROBOT, "elbow", 0.0, 1.0)
    assert posture[0] == pytest.approx(goal[0], abs=0.01)
    assert posture[-1] == pytest.approx(goal[round(1.0 / STEP_S)], abs=0.03)


def test_a_servo_whose_position_was_not_read_is_refused():
    silent = recording(0, goals(3.0), goals(3.0), silent=("shoulder",))
    with pytest.raises(RecordingError, match=r"shoulder.*was not read"):
        observe([silent], ROBOT, "elbow")


def test_a_joint_of_another_tree_need_not_be_read():
    """Two levers beside each other: neither bears the other."""
    rig = load_robot("sts3215-lever")
    mount = rig.by_joint["lever"]
    table = rig.tables[mount.servo_id]
    rows = [
        SimpleNamespace(
            t_s=0.01 * k,
            t_reply_s=0.01 * k,
            servo_id=mount.servo_id,
            op="read",
            register="present_position",
            raw=table["present_position"].encode(table["present_position"].from_si(0.01 * k)),
        )
        for k in range(40)
    ]
    (one,) = observe(
        [Recording.of(rows, {"name": "pulled", "robot": "sts3215-lever"})], rig, "lever"
    )
    assert one.posture_rad.shape[1] == len(rig.servos)


def test_a_joint_bears_what_the_others_make_of_it():
    """A level forearm loads the shoulder more than one that is folded back."""
    loads = []
    for elbow in (0.0, 2.5):
        still = np.tile([{"elbow": elbow}.get(j.name, 0.0) for j in ARM.joints], (50, 1))
        observed = observe([recording(0, still, still)], ROBOT, "shoulder")
        model = JointModel(ARM, ROBOT, observed)
        candidate = model.candidate(Hypothesis(), np.zeros(len(model.nuisances)), 0)
        loads.append(float(np.hypot(candidate.load.sine_nm[0], candidate.load.cosine_nm[0])))
    assert loads[0] > 1.3 * loads[1]


def test_every_moving_joint_has_its_findings(found):
    assert [f.model.observed[0].joint for f in found.findings] == list(MOVING)
    assert "base never moves: left out" in found.told
    assert "base was left out: it never moves" in together(found.findings).limits
    assert all(isinstance(f, JointFindings) for f in found.findings)


def test_the_effect_is_named_at_its_joint_only(found):
    (cause,) = together(found.findings).causes
    assert (cause.effect, cause.scope) == ("transport_delay", ("elbow",))


def test_one_document_holds_all_joints(found, tmp_path):
    write(ROBOT, found.findings, tmp_path, date(2024, 1, 2))
    document = json.loads((tmp_path / "diagnosis.json").read_text())
    assert list(document["details"]["joints"]) == list(MOVING)
    rows = document["details"]["joints"].values()
    ends = sorted(row["before"] for row in rows)
    assert ends[0] < document["fit"]["before"] < ends[1]
    (added,) = [
        a
        for a in additions(load_robot(tmp_path / "model.toml"))
        if a.effect.name == "transport_delay" and a.estimates["delay_s"].ci95
    ]
    assert added.where == ("elbow",)


def test_what_the_robot_has_once_is_added_once_and_masses_are_not(found, tmp_path):
    moved = []
    for f in found.findings:
        z = f.after.z.copy()
        z[[i for i, n in enumerate(f.model.nuisances) if n.name in ("sampling", "link")]] = 2.0
        moved.append(replace(f, after=replace(f.after, z=z)))
    write(ROBOT, moved, tmp_path, date(2024, 1, 2))
    names = [a.effect.name for a in additions(load_robot(tmp_path / "model.toml"))]
    assert names.count("read_skew") == 1
    assert "link_mass" not in names


def test_something_left_at_one_joint_is_left_in_the_arm(found):
    first, second = found.findings
    rest = ({"channel": "present_position", "joints": ["shoulder"]},)

    def verdict(causes, unexplained):
        changed = replace(first.diagnosis, causes=causes, unexplained=unexplained)
        bare = replace(second.diagnosis, causes=(), unexplained=())
        pair = [replace(first, diagnosis=changed), replace(second, diagnosis=bare)]
        return together(pair).verdict

    causes = together(found.findings).causes
    assert verdict((), ()) == "consistent"
    assert verdict((), rest) == "unexplained"
    assert verdict(causes, ()) == "explained"
    assert verdict(causes, rest) == "partly_explained"


def test_a_walker_is_refused():
    with pytest.raises(DiagnosisError, match="walks"):
        diagnose(load_robot("marvin"), Split((), ()))


def test_an_arm_that_never_moves_is_refused():
    still = np.zeros((50, len(ARM.joints)))
    with pytest.raises(DiagnosisError, match="no joint of arm moves"):
        diagnose(ROBOT, Split((recording(0, still, still),), ()))
