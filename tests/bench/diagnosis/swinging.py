"""Short recordings of a pendulum whose drive has more viscous friction than its file says."""

from math import nan
from types import SimpleNamespace

import numpy as np

from bench.diagnosis.joint.model import Hypothesis, JointModel
from bench.diagnosis.knobs import effect_knobs
from bench.diagnosis.observed import observe
from bench.recording import Recording
from busemu.tables import load_robot
from sim.effects import effect
from sim.model import read_model
from sim.rollout import Batch

ROBOT = "xl330-pendulum"
SERVO = 1
STEP_S = 0.02
DURATION_S = 2.0
SPEEDS_RAD_S = (3.0, 5.0, 8.0, 12.0)


def swings(effect_name=None, size=0.0, speeds=SPEEDS_RAD_S, moving=True):
    """Recordings of sines of several speeds, a group each; ``size`` in typical sizes."""
    robot = load_robot(ROBOT)
    drafts = [_recording(robot, i, speed, None, moving) for i, speed in enumerate(speeds)]
    observed = observe(drafts, robot, "arm")
    model = JointModel(read_model(robot), robot, observed)
    knobs = effect_knobs(effect(effect_name)) if effect_name else ()
    z = np.array([*np.zeros(len(model.nuisances)), *(size for _ in knobs)])
    candidates = [model.candidate(Hypothesis(knobs), z, r) for r in range(len(observed))]
    outs = Batch([o.replay for o in observed]).run(candidates, range(len(observed)))
    return [
        _recording(robot, i, speed, out[:, 0] if moving else None, moving)
        for i, (speed, out) in enumerate(zip(speeds, outs, strict=True))
    ]


def stuck():
    """Recordings of goals that move and a joint that does not."""
    robot = load_robot(ROBOT)
    return [_recording(robot, i, speed, None, True) for i, speed in enumerate(SPEEDS_RAD_S)]


def _recording(robot, number, speed, positions, moving):
    table = robot.tables[SERVO]
    rows = []
    for k in range(round(DURATION_S / STEP_S)):
        t_s = k * STEP_S
        goal = 0.7 * np.sin(speed * t_s) if moving else 0.0
        seen = 0.0 if positions is None else float(positions[k])
        rows.append(_access(table, t_s, "write", "goal_position", goal))
        rows.append(_access(table, t_s + 0.002, "read", "present_position", seen))
    metadata = {
        "name": f"swing-{number}",
        "group": f"swing-{number}",
        "robot": ROBOT,
        "source": "simulation",
        "condition": {"support": "rig", "payload_kg": 0.1, "payload_at_m": 0.1},
    }
    return Recording.of(rows, metadata)


def _access(table, t_s, op, name, value):
    register = table[name]
    raw = register.encode(register.from_si(value))
    reply = t_s + 0.001 if op == "read" else nan
    return SimpleNamespace(t_s=t_s, t_reply_s=reply, servo_id=SERVO, op=op, register=name, raw=raw)
