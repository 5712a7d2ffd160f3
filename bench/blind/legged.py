"""A legged robot of a robot file as a MuJoCo model: own reading of geometry, masses and frames.

Trunk: x right, y forward, z up, origin at the height of the coxa axes. A leg's frame: x outward, z
up; coxa turns about z, femur and tibia about -y (positive lifts the foot). The mass of a link is
spread evenly over its shapes. Every joint is two hinges in one: the rotor behind its gear, and the
gear's twist (a spring; with play, a third that is free within its limits). The servo's sensor sees
their sum.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from busemu.tables import Robot

LINKS = ("coxa", "femur", "tibia")
AXES = {"coxa": "0 0 1", "femur": "0 -1 0", "tibia": "0 -1 0"}
STEP_S = 0.5e-3
#: a rubber tip that gives is a small body on a spring; its mass and damping are assumed
TIP_KG, TIP_DAMPING_RATIO = 0.003, 0.3
#: contacts without compliance: as stiff as the step carries
HARD = "solref='0.002 1' solimp='0.95 0.99 0.0005'"
#: phase of a fast spring in one step that the engine bears well
CALM_RAD = 0.4


@dataclass(frozen=True, slots=True)
class Body:
    """What may be true of the body, feet and ground beyond the file; nothing: as the file says."""

    support: str = "ground"  #: or ``suspended``
    legs: tuple[str, ...] = ()  #: only these are there; all if empty
    link_mass: Mapping[str, float] | None = None  #: factor by ``leg.link`` or ``link``
    payload_kg: float = 0.0
    payload_at_m: tuple[float, float, float] = (0.0, 0.0, 0.03)
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: shift of the trunk's centre of mass
    tilt_x_rad: float = 0.0
    tilt_y_rad: float = 0.0
    foot_n_m: Mapping[str, float] | None = None  #: stiffness of a leg's tip; hard if missing
    ground_n_m: float = 0.0  #: stiffness of the floor as a whole; 0 is hard
    friction: float | None = None
    twist_nm_rad: Mapping[str, float] | None = None  #: gear stiffness by joint; else the file's
    play_rad: Mapping[str, float] | None = None  #: by joint


def said(document: Mapping[str, Any], *path: str, default: Any = None) -> Any:
    """The value of an entry ``{value, source}``, or a bare one."""
    found: Any = document
    for key in path:
        if key not in found:
            return default
        found = found[key]
    return found["value"] if isinstance(found, Mapping) and "value" in found else found


def numbers(values: Sequence[float]) -> str:
    """Numbers as MuJoCo reads them."""
    return " ".join(repr(float(v)) for v in values)


def _volume(shape: Mapping[str, Any]) -> float:
    size = said(shape, "size_m")
    if shape["kind"] == "box":
        return float(math.prod(size))
    if shape["kind"] == "cylinder":
        return math.pi * float(size[0]) ** 2 * float(size[1])
    return 4.0 / 3.0 * math.pi * float(size[0] if isinstance(size, list) else size) ** 3


def _geoms(
    shapes: Sequence[Mapping[str, Any]], mass_kg: float, shift: Sequence[float] = (0.0, 0.0, 0.0)
) -> str:
    """Shapes with a mass spread evenly; they touch nothing but the ground."""
    density = mass_kg / sum(_volume(shape) for shape in shapes)
    text = ""
    for shape in shapes:
        size = said(shape, "size_m")
        half = {
            "box": lambda s: [0.5 * side for side in s],
            "cylinder": lambda s: [s[0], 0.5 * s[1]],
            "sphere": lambda s: [s[0] if isinstance(s, list) else s],
        }[shape["kind"]](size)
        at = [a + b for a, b in zip(said(shape, "at_m"), shift, strict=True)]
        pitch = said(shape, "pitch_rad", default=0.0)
        text += (
            f"<geom type='{shape['kind']}' size='{numbers(half)}' pos='{numbers(at)}' "
            f"euler='0 {-float(pitch)!r} 0' mass='{density * _volume(shape)!r}' "
            f"contype='1' conaffinity='2' friction='0.5' {HARD}/>"
        )
    return text


def drive_of(robot: Robot, model: str) -> Mapping[str, Any]:
    """The file's numbers of a servo model's drive."""
    found: Mapping[str, Any] = robot.document["drive"][model]
    return found


def document(robot: Robot, body: Body) -> str:
    """The MuJoCo document of a robot."""
    file = robot.document
    total = said(file, "trunk", "mass_kg") + said(file, "trunk", "battery_kg", default=0.0)
    trunk = _geoms(file["trunk"]["shape"], total, body.com_m)
    if body.payload_kg > 0.0:
        trunk += (
            f"<geom type='box' size='0.03 0.03 0.008' pos='{numbers(body.payload_at_m)}' "
            f"mass='{body.payload_kg!r}' contype='0' conaffinity='0'/>"
        )
    legs = "".join(
        _leg(robot, leg, body) for leg in file["leg"] if not body.legs or leg["name"] in body.legs
    )
    free = "<freejoint name='base'/>" if body.support == "ground" else ""
    gravity = (
        9.81 * math.sin(body.tilt_y_rad),
        -9.81 * math.sin(body.tilt_x_rad),
        -9.81 * math.cos(body.tilt_x_rad) * math.cos(body.tilt_y_rad),
    )
    return (
        "<mujoco><compiler angle='radian' autolimits='true'/>"
        f"<option timestep='{STEP_S}' integrator='implicitfast' cone='elliptic' impratio='10' "
        f"gravity='{numbers(gravity)}'/>"
        f"<worldbody>{_ground(body)}<body name='trunk' pos='0 0 {rest_height_m(robot)!r}'>"
        f"{free}{trunk}{legs}</body></worldbody></mujoco>"
    )


def _ground(body: Body) -> str:
    if body.support != "ground":
        return ""
    plate = f"contype='2' conaffinity='1' friction='1' {HARD}"
    if body.ground_n_m <= 0.0:
        return f"<geom name='ground' type='plane' size='0 0 1' {plate}/>"
    # a floor that gives as a whole: a heavy slab on springs
    mass = 3.0
    damping = 2.0 * 0.3 * math.sqrt(body.ground_n_m * mass)
    sunk = mass * 9.81 / body.ground_n_m
    return (
        f"<body name='floor' pos='0 0 -0.05'><joint name='floor' type='slide' axis='0 0 1' "
        f"stiffness='{body.ground_n_m!r}' damping='{damping!r}' springref='{sunk!r}'/>"
        f"<geom name='ground' type='box' size='5 5 0.05' mass='{mass!r}' {plate}/></body>"
    )


def _leg(robot: Robot, leg: Mapping[str, Any], body: Body) -> str:
    file = robot.document
    name = str(leg["name"])
    opened = (
        f"<body name='{name}' pos='{numbers((leg['x_m'], leg['y_m'], 0.0))}' "
        f"euler='0 0 {float(leg['yaw_rad'])!r}'>"
    )
    closed = "</body>"
    at = 0.0
    for link in LINKS:
        entry = file["link"][link]
        joint = f"{name}.{link}"
        factors = body.link_mass or {}
        factor = factors.get(joint, factors.get(link, 1.0))
        opened += (
            f"<body name='{joint}' pos='{at!r} 0 0'>{_joint(robot, joint, link, body)}"
            f"{_geoms(entry['shape'], said(entry, 'mass_kg') * factor - _tip_kg(body, joint))}"
        )
        closed += "</body>"
        at = float(said(entry, "length_m"))
    return opened + _foot(file, name, at, body) + closed


def _tip_kg(body: Body, joint: str) -> float:
    """Mass of a tip on a spring, which is part of its tibia's."""
    leg, link = joint.split(".")
    return TIP_KG if link == "tibia" and (body.foot_n_m or {}).get(leg, 0.0) > 0.0 else 0.0


def _joint(robot: Robot, joint: str, link: str, body: Body) -> str:
    drive = drive_of(robot, robot.by_joint[joint].model)
    armature = said(drive, "motor_inertia_kg_m2") * said(drive, "gear_ratio") ** 2
    axis = AXES[link]
    text = (
        f"<joint name='{joint}' type='hinge' axis='{axis}' armature='{armature!r}' "
        f"frictionloss='{said(drive, 'coulomb_nm')!r}' damping='1e-3' "
        f"solreffriction='{2.0 * STEP_S} 1' solimpfriction='0.9999 0.9999 0.001'/>"
    )
    stiffness = said(drive, "gear_stiffness_nm_rad", default=0.0)
    damping = said(drive, "gear_damping_nm_s_rad", default=0.0)
    play = (body.play_rad or {}).get(joint, 0.0)
    changed = (body.twist_nm_rad or {}).get(joint)
    if changed is not None:
        stiffness = changed
    if stiffness > 0.0:
        text += (
            f"<joint name='{joint}/twist' type='hinge' axis='{axis}' damping='{damping!r}' "
            f"stiffness='{stiffness!r}'/>"
        )
    if play > 0.0:
        # between spring and teeth sits a gear, as heavy as a step of the spring needs it; assumed
        gear = max(1e-6, stiffness * (STEP_S / CALM_RAD) ** 2)
        text += (
            f"<joint name='{joint}/play' type='hinge' axis='{axis}' damping='2e-4' "
            f"range='{-0.5 * play!r} {0.5 * play!r}' armature='{gear!r}' "
            f"solreflimit='{2.0 * STEP_S} 1' solimplimit='0.95 0.999 0.0005'/>"
        )
    return text


def _foot(file: Mapping[str, Any], name: str, at_m: float, body: Body) -> str:
    friction = body.friction
    if friction is None:
        friction = float(said(file, "contact", "friction"))
    radius = float(said(file, "contact", "foot_radius_m"))
    geom = (
        f"<geom name='{name}' type='sphere' size='{radius!r}' contype='1' conaffinity='2' "
        f"condim='4' friction='{friction!r} 0.002' priority='1' {HARD}"
    )
    stiffness = (body.foot_n_m or {}).get(name, 0.0)
    if stiffness <= 0.0:
        return f"{geom} pos='{at_m!r} 0 0' mass='1e-6'/>"
    damping = 2.0 * TIP_DAMPING_RATIO * math.sqrt(stiffness * 0.1)
    return (
        f"<body name='{name}/tip' pos='{at_m!r} 0 0'><joint name='{name}/tip' type='slide' "
        f"axis='1 0 0' stiffness='{stiffness!r}' damping='{damping!r}'/>"
        f"{geom} mass='{TIP_KG!r}'/></body>"
    )


def rest_height_m(robot: Robot) -> float:
    """Height of the trunk's origin above the ground with belly and feet on it."""
    file = robot.document
    lowest = 0.0
    for shape in file["trunk"]["shape"]:
        size = said(shape, "size_m")
        half = {"box": lambda s: s[2] / 2, "cylinder": lambda s: s[1] / 2}.get(
            shape["kind"], lambda s: s[0]
        )(size)
        lowest = min(lowest, said(shape, "at_m")[2] - half)
    femur, tibia = (said(file, "rest", f"{link}_rad", default=0.0) for link in ("femur", "tibia"))
    a, b = (said(file, "link", link, "length_m") for link in ("femur", "tibia"))
    foot = a * math.sin(femur) + b * math.sin(femur + tibia)
    foot -= said(file, "contact", "foot_radius_m")
    return float(-min(lowest, foot)) + 1e-4


def rest_rad(robot: Robot) -> dict[str, float]:
    """Angle of every joint at rest [rad]."""
    rest = robot.document.get("rest", {})
    return {
        servo.joint: float(said(rest, f"{servo.joint.split('.')[1]}_rad", default=0.0))
        for servo in robot.servos
    }
