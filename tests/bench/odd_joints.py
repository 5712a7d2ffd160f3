"""Recordings of a joint that moves, to put something odd into, and the oddities of one kind."""

import numpy as np
import pyarrow as pa

from bench.recording import Recording, oddities

FORMAT = "busemu-recording/1"


def joint(seconds=6.0, period_s=0.02, noise=0.7, **more):
    """A servo that follows a sine a little late: goals, positions, duty, voltage; as columns."""
    t = np.arange(0.0, seconds, period_s)
    rng = np.random.default_rng(1)
    goal = np.round(2048 + 300 * np.sin(2 * t))
    position = np.round(2048 + 290 * np.sin(2 * t - 0.1) + rng.normal(0, noise, len(t)))
    duty = np.round(0.1 * (goal - position) * 8)
    columns = {
        ("goal_position", "write"): (t, goal),
        ("present_position", "read"): (t + 0.002, position),
        ("present_pwm", "read"): (t + 0.003, np.where(duty < 0, duty + 65536, duty)),
        ("present_input_voltage", "read"): (t + 0.004, np.round(50 + rng.normal(0, 0.3, len(t)))),
    }
    return {key: (times.copy(), raw.copy()) for key, (times, raw) in columns.items()} | more


def recording(columns, **metadata):
    parts = [
        (
            times,
            np.where(op == "read", times + 0.001, np.nan) if len(times) else times,
            raw,
            name,
            op,
        )
        for (name, op), (times, raw) in columns.items()
    ]
    t_s = np.concatenate([p[0] for p in parts])
    order = np.argsort(t_s, kind="stable")
    names = np.concatenate([np.full(len(p[0]), p[3]) for p in parts])[order]
    table = pa.table(
        {
            "t_s": t_s[order],
            "t_reply_s": np.concatenate([p[1] for p in parts])[order],
            "servo_id": np.array([0 if "/" in name else 1 for name in names], dtype=np.int16),
            "op": np.concatenate([np.full(len(p[0]), p[4]) for p in parts])[order],
            "register": names,
            "raw": np.concatenate([p[2] for p in parts])[order],
        }
    )
    facts = {"format": FORMAT, "name": "sample", "robot": "xl330-pendulum"} | metadata
    return Recording.checked(table, facts)


def found(columns, kind, **metadata):
    return [odd for odd in oddities(recording(columns, **metadata)).found if odd.kind == kind]
