"""Programmes of fewer and shorter motions: what is left of an effect takes dozens of rollouts."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator
from contextlib import contextmanager

import pytest

from bench.blind import rigs


@contextmanager
def short(of: str, without: Collection[str] = ()) -> Iterator[None]:
    """Rigs also have "short ...": another programme's motions, for half as long."""
    usual = rigs._programmes

    def programmes(rig: rigs.Rig) -> tuple[rigs.Programme, ...]:
        every = usual(rig)
        (longer,) = (p for p in every if p.name == of)
        runs = tuple(halved(run) for run in longer.runs if run.group not in without)
        return *every, dataclasses.replace(longer, name=f"short {of}", runs=runs)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rigs, "_programmes", programmes)
        yield


def halved(run: rigs.Run) -> rigs.Run:
    motion = run.plan.motion
    motion = dataclasses.replace(motion, duration_s=0.5 * motion.duration_s)
    return dataclasses.replace(run, plan=dataclasses.replace(run.plan, motion=motion))
