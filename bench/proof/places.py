"""Where a robot's misfit is: joints and phase of the gait, as told and as it truly is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bench.blind.scenes import SCENES

#: share in one phase from which it is that phase's, twice the other's; else it is in all
MOSTLY = 2.0 / 3.0
STANCE, SWING, ALL = "stance", "swing", "all"


@dataclass(frozen=True, slots=True)
class Place:
    """Where something is in a robot, told against true."""

    f1: float  #: of the joints that named causes are in; without a cause, of the mismatch's
    mismatch_f1: float  #: of the joints that the mismatch lists
    everywhere: bool  #: what is hidden is in all joints: whoever says so is right
    true_stance: float  #: share of stance in what is hidden; nan where nothing walks
    told_stance: float  #: the same of what the mismatch lists; nan where none is told

    @property
    def true_phase(self) -> str:
        """The phase that what is hidden is mostly in; empty where nothing walks."""
        return phase_of(self.true_stance)

    @property
    def told_phase(self) -> str:
        """The phase that is told; empty where no mismatch is."""
        return phase_of(self.told_stance)

    @property
    def phase_right(self) -> bool:
        """Whether the phase that is told is the true one."""
        return self.told_phase == self.true_phase


def place_of(
    key: Mapping[str, Any],
    own_causes: Sequence[Mapping[str, Any]],
    mismatch: Sequence[Mapping[str, Any]],
) -> Place | None:
    """How well a robot's misfit was found; ``own_causes`` are those that are no ordinary misfit.

    ``None`` where nothing is hidden.
    """
    if not key["effects"]:
        return None
    every, stance = SCENES[key["rig"]].joints, key["stance_share"]
    hidden = {joint for effect in key["effects"] for joint in effect["joints"]}
    true = hidden | {joint for effect in key["ordinary"] for joint in effect["joints"]}
    listed = {joint for row in mismatch for joint in row["joints"]}
    of_mismatch = f1(listed, true)
    named = {joint for cause in own_causes for joint in joints_of(cause["scope"], every)}
    return Place(
        f1=f1(named, hidden) if own_causes else of_mismatch,
        mismatch_f1=of_mismatch,
        everywhere=len(hidden) == len(every),
        true_stance=math.nan if stance is None else float(stance),
        told_stance=_told_stance(mismatch),
    )


def joints_of(scope: Iterable[str], joints: Sequence[str]) -> set[str]:
    """Joints of a cause's scope: of legs, of bodies, or all of a cause that is in the whole robot.

    A body is moved by the joint of its name; the trunk is carried by all.
    """
    places = set(scope)
    if not places or "trunk" in places:
        return set(joints)
    return {joint for joint in joints if {joint, joint.split(".")[0]} & places}


def f1(told: set[str], true: set[str]) -> float:
    """Harmonic mean of the shares of the told that are true and of the true that are told."""
    return 2.0 * len(told & true) / (len(told) + len(true))


def phase_of(stance_share: float) -> str:
    """The phase that a misfit is mostly in; empty where its share of stance is nan."""
    if math.isnan(stance_share):
        return ""
    if stance_share >= MOSTLY:
        return STANCE
    return SWING if stance_share <= 1.0 - MOSTLY else ALL


def _told_stance(mismatch: Sequence[Mapping[str, Any]]) -> float:
    total = sum(float(row["share"]) for row in mismatch)
    if total <= 0.0:
        return math.nan
    return sum(float(r["share"]) for r in mismatch if r["phase"] == STANCE) / total
