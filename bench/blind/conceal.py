"""A disguise of the raw misfit: that of a case is made to look like a null's."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from .case import Case, Hidden
from .changes import Setting
from .effects import POSITION
from .sizing import observe, rms, traces

TORQUE_FACTORS = (0.90, 0.95, 1.0, 1.05, 1.10)
LIKE = 0.10  #: raw misfits within 10 % of each other pass for one


def raw_rmse(case: Case, hidden: tuple[Hidden, ...]) -> float:
    """RMSE of a case's traces against the believed model, with other effects in it [rad]."""
    where = case.ground
    other = dataclasses.replace(case, hidden=hidden)
    found = [observe(where.style, run, other.specimen(run.plan)) for run in where.programme.runs]
    return rms(np.concatenate(found) - traces(where, None, 0.0, Setting()))


def disguise(case: Case) -> tuple[Case, dict[str, Any]]:
    """Retune the torque constant, within its bounds, until the raw misfit is that of a null.

    Returns the case and what came of it; a case that is not to be disguised as it is.
    """
    if not case.disguised or any(h.effect.channel != POSITION for h in case.hidden):
        return case, {}
    null = raw_rmse(case, ())

    def tuned(factor: float) -> Case:
        changed = dataclasses.replace(case.nuisances, torque_constant_factor=factor)
        return dataclasses.replace(case, nuisances=changed)

    tried = [(abs(raw_rmse(tuned(f), case.hidden) - null), f) for f in TORQUE_FACTORS]
    first, second = (f for _, f in sorted(tried)[:2])
    tried.append(
        (abs(raw_rmse(tuned(0.5 * (first + second)), case.hidden) - null), 0.5 * (first + second))
    )
    _, factor = min(tried)
    best = tuned(factor)
    now = raw_rmse(best, case.hidden)
    told = {"rmse_null_rad": null, "rmse_rad": now, "matched": bool(abs(now / null - 1.0) <= LIKE)}
    return best, told
