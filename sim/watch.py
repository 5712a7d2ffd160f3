"""Noticing what must not happen: a fall, a link that touches another, a link on the ground.

A fall is named when the servos are on and the trunk touches the ground after it had stood clear of
it for :data:`STOOD_S`, or leans by more than :data:`LEANING_RAD`; it is over when the robot has
stood for that long again. A robot whose torque is off lies down; that is no fall, and its links on
the ground are nothing to tell.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

WATCH_S = 0.02  #: it is looked at so often; shorter touches may go unseen
STOOD_S = 0.5  #: assumed: standing up takes longer, and bounces are shorter
APART_S = 0.1  #: what touched within this time has not been apart: bodies chatter; assumed
LEANING_RAD = math.radians(45.0)  #: assumed: no gait leans so far

Pair = tuple[str, str]


class What(enum.Enum):
    """What was noticed."""

    FALL = "fall"
    SELF_CONTACT = "self-contact"  #: two bodies of the robot began to touch
    GROUND_CONTACT = "ground contact"  #: a body that is no foot began to touch the ground


@dataclass(frozen=True, slots=True)
class Event:
    """Something noticed: when it began, which bodies (``trunk``, or by joint name), what else."""

    t_s: float
    what: What
    bodies: tuple[str, ...]
    note: str = ""

    def __str__(self) -> str:
        where = " and ".join(self.bodies)
        return f"{self.t_s:.2f} s: {self.what.value}: {where}{self.note and f', {self.note}'}"


@dataclass(frozen=True, slots=True)
class Contacts:
    """Normal forces [N]: of the ground on each body, and between two bodies of the robot."""

    ground_n: Mapping[str, float] = field(default_factory=dict)
    own_n: Mapping[Pair, float] = field(default_factory=dict)


class Watch:
    """Turns what is seen every :data:`WATCH_S` into events; what holds at first is no event."""

    def __init__(self, feet: frozenset[str]) -> None:
        self.events: list[Event] = []
        self._feet = feet
        self._touched_s: dict[tuple[str, ...], float] | None = None  #: when they last touched
        self._upright_since_s: float | None = None  #: neither on the ground nor leaning
        self._fallen = False

    def look(self, t_s: float, contacts: Contacts, lean_rad: float, powered: bool) -> None:
        """Note what has begun since the last look.

        ``lean_rad`` is the angle between the trunk's z axis and the ground's normal, ``powered``
        whether any servo has its torque on.
        """
        ground = contacts.ground_n.keys() - self._feet
        touching = frozenset((body,) for body in ground) | frozenset(contacts.own_n)
        if self._touched_s is None:
            self._touched_s = {}
        else:
            for bodies in sorted(touching):
                what = What.SELF_CONTACT if len(bodies) == 2 else What.GROUND_CONTACT
                apart = t_s - self._touched_s.get(bodies, -math.inf) > APART_S
                if apart and (powered or what is What.SELF_CONTACT):
                    self.events.append(Event(t_s, what, bodies))
        self._touched_s |= dict.fromkeys(touching, t_s)
        self._notice_fall(t_s, "trunk" in ground, lean_rad, powered)

    def _notice_fall(self, t_s: float, lying: bool, lean_rad: float, powered: bool) -> None:
        leaning = lean_rad > LEANING_RAD
        stood = self._upright_since_s is not None and t_s - self._upright_since_s >= STOOD_S
        if lying or leaning:
            self._upright_since_s = None
        elif self._upright_since_s is None:
            self._upright_since_s = t_s
        elif stood:
            self._fallen = False
        if powered and not self._fallen and (leaning or (lying and stood)):
            self._fallen = True
            note = "on the ground" if lying else f"leans by {math.degrees(lean_rad):.0f} deg"
            self.events.append(Event(t_s, What.FALL, ("trunk",), note))
