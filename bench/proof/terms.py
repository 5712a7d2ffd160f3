"""Terms of an equation of motion at every sample of a recording, for regressions of a residual."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from bench.diagnosis.joint.model import Blocks, JointModel

Floats = NDArray[np.float64]

SMOOTH_S = 0.03  #: over which positions are smoothed before they are differentiated
LAGS_S = (0.0, 0.02, 0.05, 0.1, 0.2)
SLOW_RAD_S = 0.2  #: below which friction is mostly that of standstill
SMALL_RAD = 0.01

#: terms, and the effect of the catalogue whose signature each is
EFFECT_OF: Mapping[str, str] = MappingProxyType(
    {
        "1": "zero_offset",
        "q": "cable_drag",
        "sin q": "link_mass",
        "cos q": "com_offset",
        "sign v": "coulomb_friction",
        "v": "viscous_friction",
        "sign v at rest": "stribeck_friction",
        "|sin q| sign v": "load_friction",
        "a": "rotor_inertia",
        "goal rate": "transport_delay",
        "error": "gain_error",
        "sign error": "dead_zone",
        "reversal": "backlash",
        "torque": "joint_compliance",
        "integral": "integral_action",
        "late": "thermal_derating",
    }
)


def smoothed(t: Floats, values: Floats) -> Floats:
    """A running mean over :data:`SMOOTH_S`."""
    pace = max(float(np.median(np.diff(t))), 1e-4)
    span = max(3, round(SMOOTH_S / pace) | 1)
    padded = np.pad(values, span // 2, mode="edge")
    out: Floats = np.convolve(padded, np.ones(span) / span, mode="valid")
    return out


def library(model: JointModel, found: Blocks) -> tuple[Floats, Floats]:
    """Terms in the order of :data:`EFFECT_OF`, shape (n, terms), and the residual (n,) [rad]."""
    rows, residuals = [], []
    for (r, _), block in found.items():
        samples = model.observed[r].position
        t = block.t_s
        q = smoothed(t, np.interp(t, samples.t_s[samples.good], samples.value[samples.good]))
        v = np.gradient(q, t)
        a = np.gradient(smoothed(t, v), t)
        goal_t, goal_values = model.observed[r].goal
        goal = np.interp(t, goal_t, goal_values)
        error = goal - q
        way = np.tanh(v / 0.02)
        last = np.sign(v[np.maximum.accumulate(np.where(np.abs(v) > 0.02, np.arange(len(v)), 0))])
        rows.append(
            np.stack(
                [
                    np.ones_like(q),
                    q,
                    np.sin(q),
                    np.cos(q),
                    way,
                    v,
                    way * np.exp(-((v / SLOW_RAD_S) ** 2)),
                    np.abs(np.sin(q)) * way,
                    a,
                    np.gradient(smoothed(t, goal), t),
                    error,
                    np.tanh(error / SMALL_RAD),
                    last,
                    error * np.abs(error),
                    np.cumsum(error) * float(np.median(np.diff(t))),
                    error * t,
                ],
                axis=1,
            )
        )
        residuals.append(block.value)
    return np.concatenate(rows), np.concatenate(residuals)


def lagged(model: JointModel, found: Blocks) -> tuple[Floats, Floats]:
    """Goal and goal rate now and before, with their products: what a black box is fed."""
    rows, residuals = [], []
    for (r, _), block in found.items():
        goal_t, goal_values = model.observed[r].goal
        samples = model.observed[r].position
        t = block.t_s
        q = np.interp(t, samples.t_s[samples.good], samples.value[samples.good])
        modelled = q - block.value
        plain = [np.ones_like(t), modelled, np.gradient(smoothed(t, modelled), t)]
        for lag in LAGS_S:
            plain.append(np.interp(t - lag, goal_t, goal_values) - modelled)
        first = np.stack(plain, axis=1)
        count = first.shape[1]
        pairs = [first[:, i] * first[:, j] for i in range(1, count) for j in range(i, count)]
        bends = np.tanh(first[:, 1:] / (np.std(first[:, 1:], axis=0) + 1e-9))
        rows.append(np.concatenate([first, np.stack(pairs, axis=1), bends], axis=1))
        residuals.append(block.value)
    return np.concatenate(rows), np.concatenate(residuals)
