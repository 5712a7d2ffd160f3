"""What is around a robot: its ground, slabs on it, a payload, pushes.

A scene comes from a TOML file::

    format = "busemu-world/1"

    [ground]                 # all of it; every entry may be left out
    friction = 1.0           # times the foot's
    stiffness_n_m = 5000.0   # absent: hard
    damping_n_s_m = 10.0
    pitch_rad = 0.1          # a slope: rises towards +y (forward)
    roll_rad = 0.0           # falls towards +x (right)

    [payload]                # in place of what the robot carries
    mass_kg = 0.2
    at_m = [0.0, 0.0, 0.03]  # on a hexapod's trunk, trunk frame; on a rig from its payload's place

    [[slab]]                 # a step, a mat, a slippery patch: a box on the ground
    at_m = [0.0, 0.5]        # its middle
    size_m = [1.0, 0.2]
    height_m = 0.01          # 0.2 mm where nothing is said: a patch of other friction
    yaw_rad = 0.0
    friction = 0.3           # and stiffness_n_m, damping_n_s_m as above

    [[push]]
    at_s = 3.0               # since the start
    for_s = 0.1
    force_n = [2.0, 0.0, 0.0]  # ground frame
    body = "trunk"           # or a joint's name: the body that it moves
    at_m = [0.0, 0.0, 0.0]   # where it acts, in that body's frame

The ground frame has its z axis along the normal; the robot starts at its origin, heading to +y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

from busemu.tables.toml_file import read_toml

from .entries import PhysicsError, Section
from .shapes import Vector
from .tree import Ground, Payload, PhysicalRobot

FORMAT = "busemu-world/1"
PATCH_M = 0.0002  #: height of a slab that is only a patch: less than any foot notices; assumed
STEEPEST_RAD = 0.7
SOFTEST_N_M, HARDEST_N_M = 100.0, 1e7
GROUND_KEYS = ("friction", "stiffness_n_m", "damping_n_s_m")


@dataclass(frozen=True, slots=True)
class Slab:
    """A box on the ground with a surface of its own; ``size_m`` is along its own x and y."""

    at_m: tuple[float, float]
    size_m: tuple[float, float]
    height_m: float
    yaw_rad: float
    surface: Ground  #: friction, stiffness and damping; its tilt means nothing

    def near(self, radius_m: float) -> bool:
        """Whether it comes within a radius of the origin."""
        turn = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x = -self.at_m[0] * turn[0] - self.at_m[1] * turn[1]
        y = self.at_m[0] * turn[1] - self.at_m[1] * turn[0]
        beyond = (
            max(0.0, abs(c) - 0.5 * size) for c, size in zip((x, y), self.size_m, strict=True)
        )
        return math.hypot(*beyond) < radius_m


@dataclass(frozen=True, slots=True)
class Push:
    """A force on a body for a while (``body`` is ``trunk`` or the joint that moves it)."""

    at_s: float
    for_s: float
    force_n: Vector  #: ground frame
    body: str
    at_m: Vector  #: in the body's frame


@dataclass(frozen=True, slots=True)
class Scene:
    """All that is around a robot; as it is made: hard, level ground and nothing on it."""

    ground: Ground = field(default_factory=Ground)
    slabs: tuple[Slab, ...] = ()
    pushes: tuple[Push, ...] = ()
    payload: Payload | None = None

    def around(self, robot: PhysicalRobot) -> PhysicalRobot:
        """The robot on this ground, with this payload.

        An effect of the robot's own model adds its tilt and its softness. Raises
        :class:`PhysicsError` where the robot has no such thing as the scene asks for.
        """
        if robot.trunk is None and self.slabs:
            raise PhysicsError(f"{robot.name} has a fixed base: a world for it has no [[slab]]")
        known = {"trunk"} if robot.trunk is not None else set()
        known |= {body.name for body in robot.bodies}
        for push in self.pushes:
            if push.body not in known:
                raise PhysicsError(
                    f"[[push]] body {push.body!r}: {robot.name} has no such body, but "
                    f"{', '.join(sorted(known))}"
                )
        if self.payload is not None:
            robot = replace(robot, payload=_carried(self.payload, robot))
        if self.ground == Ground():
            return robot
        return replace(robot, ground=_on(self.ground, robot.ground))


def read_scene(path: Path) -> Scene:
    """A scene from a file. Raises :class:`PhysicsError` with one line."""
    document = read_toml(path, PhysicsError)
    if document.get("format") != FORMAT:
        raise PhysicsError(f'{path}: needs the line format = "{FORMAT}" at its top')
    top = Section(path, "", document)
    unknown = sorted(set(document) - {"format", "ground", "payload", "slab", "push"})
    if unknown:
        raise PhysicsError(
            f"{path}: unknown section {unknown[0]}; known are [ground], [payload], [[slab]] and "
            "[[push]]"
        )
    return Scene(
        ground=_ground(top.section("ground")) if "ground" in top else Ground(),
        slabs=tuple(_slab(row) for row in top.sections("slab")) if "slab" in top else (),
        pushes=tuple(_push(row) for row in top.sections("push")) if "push" in top else (),
        payload=_payload(top.section("payload")) if "payload" in top else None,
    )


def _carried(payload: Payload, robot: PhysicalRobot) -> Payload:
    """A payload on a hexapod's trunk, or where a rig carries its own."""
    if robot.trunk is not None:
        return payload
    own = robot.payload
    if own is None:
        raise PhysicsError(
            f"[payload] mass_kg = {payload.mass_kg:g} kg: {robot.name} has no [payload] in its "
            "file that says where a weight is fixed"
        )
    x, y, z = (a + b for a, b in zip(own.at_m, payload.at_m, strict=True))
    return Payload(own.body, (x, y, z), payload.mass_kg)


def _on(scene: Ground, model: Ground) -> Ground:
    """The scene's ground with the departures of a robot's model."""
    softness = 1.0 / scene.stiffness_n_m + 1.0 / model.stiffness_n_m
    return Ground(
        friction=scene.friction * model.friction,
        stiffness_n_m=1.0 / softness if softness else math.inf,
        damping_n_s_m=scene.damping_n_s_m + model.damping_n_s_m,
        pitch_rad=scene.pitch_rad + model.pitch_rad,
        roll_rad=scene.roll_rad + model.roll_rad,
    )


def _ground(section: Section) -> Ground:
    section.only(*GROUND_KEYS, "pitch_rad", "roll_rad")
    tilts = {
        key: section.plain(key, "rad", -STEEPEST_RAD, STEEPEST_RAD)
        for key in ("pitch_rad", "roll_rad")
        if key in section
    }
    return replace(_surface(section), **tilts)


def _surface(section: Section) -> Ground:
    ground = Ground()
    if "friction" in section:
        ground = replace(ground, friction=section.plain("friction", "(ratio)", 0.0, 10.0))
    if "stiffness_n_m" in section:
        stiffness = section.plain("stiffness_n_m", "N/m", SOFTEST_N_M, HARDEST_N_M)
        ground = replace(ground, stiffness_n_m=stiffness)
    if "damping_n_s_m" in section:
        if "stiffness_n_m" not in section:
            raise section.fail("damping_n_s_m needs a stiffness_n_m beside it")
        damping = section.plain("damping_n_s_m", "N s/m", 0.0, 1e4)
        ground = replace(ground, damping_n_s_m=damping)
    return ground


def _slab(section: Section) -> Slab:
    section.only("at_m", "size_m", "height_m", "yaw_rad", *GROUND_KEYS)
    height, yaw = PATCH_M, 0.0
    if "height_m" in section:
        height = section.plain("height_m", "m", 1e-5, 1.0)
    if "yaw_rad" in section:
        yaw = section.plain("yaw_rad", "rad", -math.pi, math.pi)
    x, y = section.plains("at_m", "m", 2, -100.0, 100.0)
    across, along = section.plains("size_m", "m", 2, 0.001, 100.0)
    return Slab((x, y), (across, along), height, yaw, _surface(section))


def _push(section: Section) -> Push:
    section.only("at_s", "for_s", "force_n", "body", "at_m")
    body = section.word("body") if "body" in section else "trunk"
    return Push(
        section.plain("at_s", "s", 0.0, 1e6),
        section.plain("for_s", "s", 0.001, 1e6),
        _vector(section, "force_n", "N", 1000.0),
        body,
        _vector(section, "at_m", "m", 2.0) if "at_m" in section else (0.0, 0.0, 0.0),
    )


def _payload(section: Section) -> Payload:
    section.only("mass_kg", "at_m")
    at = _vector(section, "at_m", "m", 2.0) if "at_m" in section else (0.0, 0.0, 0.0)
    return Payload(None, at, section.plain("mass_kg", "kg", 0.0, 20.0))


def _vector(section: Section, key: str, unit: str, largest: float) -> Vector:
    x, y, z = section.plains(key, unit, 3, -largest, largest)
    return x, y, z
