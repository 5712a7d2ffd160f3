"""Recordings of a pendulum on an XL330, made by the compiled rollouts: counts and all."""

from collections.abc import Mapping
from dataclasses import replace
from math import inf, nan
from types import SimpleNamespace

import numpy as np

from bench.diagnosis.joint.model import Hypothesis, JointModel
from bench.diagnosis.observed import observe
from bench.recording import Recording
from busemu.tables import load_robot
from sim.drive import lanes
from sim.effects import effect
from sim.model import read_model
from sim.rollout import Batch

ROBOT, SERVO, JOINT = "xl330-pendulum", 1, "arm"
PACE_S = 0.01  #: of a bus that reads and writes one servo
REST_S = 0.1  #: before a motion begins
CONDITION = {"support": "rig", "payload_kg": 0.15, "payload_at_m": 0.1}
CHANNELS = {
    "present_position": lanes.OUT_POSITION,
    "present_pwm": lanes.OUT_DUTY,
    "present_input_voltage": lanes.OUT_VOLTAGE,
}
POSITION, DUTY, VOLTS = CHANNELS

#: goals [rad] over the time since a motion began [s]
MOTIONS = {
    "slow": lambda t: 1.2 * np.sin(2.0 * t),
    "fast": lambda t: 0.5 * np.sin(9.0 * t),
    "steps": lambda t: 0.8 * np.sign(np.sin(4.2 * t)),
    "swell": lambda t: 0.4 * t * np.sin(5.0 * t),
}


def robot():
    return load_robot(ROBOT)


def logs(
    truth: Mapping[str, Mapping[str, float]] | None = None,
    motions=tuple(MOTIONS),
    registers=(POSITION, DUTY),
    duration_s=3.0,
    noise_rad=0.0,
    seed=0,
    condition=CONDITION,
    groups=None,
    settings=None,
    speed_rad_s=0.0,
    sprung=False,
    held=1,
    pace_s=PACE_S,
    limp_s=inf,
):
    """One recording a motion; ``truth`` is effects with their parameters.

    ``speed_rad_s`` is that of the joint in the beginning; the gear is rigid, or ``sprung``. A
    voltage is shown until so many reads later, ``held``; ``pace_s`` is the bus's, and from
    ``limp_s`` on the torque is off.
    """
    drafts = [
        recorded(
            name, dict.fromkeys(registers), duration_s, condition, name, settings, 0, pace_s, limp_s
        )
        for name in motions
    ]
    told = [
        replace(one, replay=replace(one.replay, velocity_rad_s=speed_rad_s))
        for one in observe(drafts, robot(), JOINT, supply_from_register=False)
    ]
    reality = read_model(robot())
    for name, values in (truth or {}).items():
        reality = effect(name).apply(reality, (), effect(name).off | values)
    real = JointModel(reality, robot(), told, sprung=sprung)
    soft = {"backlash", "joint_compliance"} & set(truth or {})
    assert sprung or not soft, "the recordings are of a rigid gear"
    none = np.zeros(len(real.nuisances))
    candidates = [real.candidate(Hypothesis(), none, r) for r in range(len(drafts))]
    outs = Batch([o.replay for o in told], 1).run(candidates, range(len(drafts)))
    random = np.random.default_rng(seed)
    made = []
    for k, (name, out) in enumerate(zip(motions, outs, strict=True)):
        seen = {r: out[:, CHANNELS[r]].copy() for r in registers}
        if VOLTS in seen:
            seen[VOLTS] = np.repeat(seen[VOLTS][::held], held)[: len(out)]
        seen[POSITION] += noise_rad * random.normal(size=len(out))
        group = groups[k] if groups else name
        made.append(recorded(name, seen, duration_s, condition, group, settings, k, pace_s, limp_s))
    return made


def recorded(
    name,
    seen,
    duration_s,
    condition,
    group,
    settings=None,
    number=0,
    pace_s=PACE_S,
    limp_s=inf,
):
    """A recording of goals of a motion, and of registers that read ``seen`` (absent: 0)."""
    table = robot().tables[SERVO]
    rows = []
    for k in range(round(duration_s / pace_s)):
        t_s = k * pace_s
        goal = float(MOTIONS[name](max(0.0, t_s - REST_S)))
        limp = t_s >= limp_s
        if limp and t_s - pace_s < limp_s:
            rows.append(raw_access(t_s, "write", "torque_enable", 0))
        elif not limp:
            rows.append(access(table, t_s, "write", "goal_position", goal))
        for register, values in seen.items():
            value = 0.0 if values is None else float(values[k])
            rows.append(access(table, t_s + 0.004, "read", register, value))
    metadata = {
        "name": f"{name}-{number}",
        "group": group,
        "robot": ROBOT,
        "source": "simulation",
        "condition": dict(condition),
    }
    if settings:
        metadata["servo"] = {str(SERVO): {"registers": dict(settings)}}
    return Recording.of(rows, metadata)


def access(table, t_s, op, name, value):
    """A value [SI], as the bus saw it."""
    return raw_access(t_s, op, name, table[name].from_si(value))


def raw_access(t_s, op, name, raw, servo_id=SERVO):
    reply = t_s + 0.0002 if op == "read" else nan
    return SimpleNamespace(
        t_s=t_s, t_reply_s=reply, servo_id=servo_id, op=op, register=name, raw=raw
    )


def model_of(recordings):
    """What the operator believes, against recordings."""
    return JointModel(read_model(robot()), robot(), observe(recordings, robot(), JOINT))
