"""Cases of legged robots: drawn from a seed like those of one joint, on a scene."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .case import COUNT, DRAWS, SHARES, Asked, Concealment, Kind
from .changes import Truth
from .legged_effects import LEGGED, LeggedEffect, Where, Whole
from .legged_sizing import base, believed, legged_ratio, standing_share, tracks, walking_ratio
from .scenes import SCENES, Plan, Scene
from .sizing import RATIOS

Floats = NDArray[np.float64]

TRIES, CLOSE, FAR = 5, 0.2, 1.5
DEGREE = math.radians(1.0)
#: of nuisances that move joints: as believed, and how far off at most; all between is as likely
TOLERANCES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "link_mass": (1.0, 0.05),
        "com_m": (0.0, 0.003),
        "zero_rad": (0.0, DEGREE),
        "torque_factor": (1.0, 0.10),
        "friction_factor": (1.0, 0.30),
        "supply_factor": (1.0, 0.015),
        "tilt_rad": (0.0, DEGREE),
    }
)
DROOP_1_S = 0.001  #: of the supply's voltage, that it may lose in a second
VOLTAGE, LOAD = "present_voltage", "present_load"
#: what is read beside the positions of a robot on its feet, and the share of the cases in which
READS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "position": (),
        "position and voltage": (VOLTAGE,),
        "position, voltage and load": (VOLTAGE, LOAD),
    }
)
READ = (0.4, 0.3, 0.3)
SENSE = 0.01, 0.005  #: how far off those are, all alike and each by itself; assumed


@dataclass(frozen=True, slots=True)
class LeggedHidden:
    """An effect in a robot; ``legs`` is where it is."""

    name: str
    size: float
    ratio: float
    wanted: float
    where: Where

    @property
    def effect(self) -> LeggedEffect:
        """The effect itself."""
        return LEGGED[self.name]

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints that it is in."""
        return tuple(self.where.joints(*self.effect.links))

    def walking(self, scene: Scene) -> float | None:
        """Its size once the robot is up, in floors; ``None`` on a stand, and of a disguise."""
        if scene.support != "ground" or math.isnan(self.ratio):
            return None
        return walking_ratio(scene.name, self.name, self.size, self.where)

    def on(self, whole: Whole) -> tuple[Whole, Truth]:
        """A robot with it, and its true parameters."""
        return self.effect.apply(whole, self.size, self.where)


@dataclass(frozen=True, slots=True)
class LeggedNuisances:
    """What is a little off in every robot, nulls included; maps are by joint."""

    link_mass: Mapping[str, float]
    com_m: tuple[float, float, float]
    zero_rad: Mapping[str, float]
    torque_factor: Mapping[str, float]
    friction_factor: Mapping[str, float]
    supply_factor: float
    droop_v_s: float
    tilt_rad: tuple[float, float]
    ambient_c: float
    lost_rate: float
    clock_ppm: float
    sense_v: Mapping[str, float]  #: what voltage registers show too much [V]

    def on(self, whole: Whole) -> Whole:
        """A believed robot as it is with these."""
        volts = whole.robot.document["supply"]["voltage_v"]["value"] * self.supply_factor
        return whole.body_but(
            link_mass=self.link_mass,
            com_m=self.com_m,
            tilt_x_rad=self.tilt_rad[0],
            tilt_y_rad=self.tilt_rad[1],
        ).electrics_but(
            supply_v=volts,
            droop_v_s=self.droop_v_s,
            zero_rad=self.zero_rad,
            torque_factor=self.torque_factor,
            friction_factor=self.friction_factor,
            sense_v=self.sense_v,
            ambient_c=self.ambient_c,
        )


def droop_most_v_s(scene: Scene) -> float:
    """How much of its voltage a battery may lose in a second [V/s]."""
    return float(scene.robot.document["supply"]["voltage_v"]["value"]) * DROOP_1_S


def _nuisances(scene: Scene, random: np.random.Generator, pins: set[str]) -> LeggedNuisances:
    joints = list(scene.robot.by_joint)

    def by_joint(name: str, pinned: bool = False) -> dict[str, float]:
        middle, spread = TOLERANCES[name]
        draws = random.uniform(-spread, spread, len(joints)) * (not pinned)
        return dict(zip(joints, (middle + draws).tolist(), strict=True))

    def within(bound: float, pinned: bool = False) -> float:
        return float(random.uniform(-bound, bound)) * (not pinned)

    com, tilt = "com" in pins, "tilt" in pins
    far, aside = (TOLERANCES[name][1] for name in ("com_m", "supply_factor"))
    return LeggedNuisances(
        link_mass=by_joint("link_mass", "link_mass" in pins),
        com_m=(within(far, com), within(far, com), within(far, com)),
        zero_rad=by_joint("zero_rad"),
        torque_factor=by_joint("torque_factor"),
        friction_factor=by_joint("friction_factor"),
        supply_factor=1.0 + within(aside, "supply" in pins),
        droop_v_s=droop_most_v_s(scene) * float(random.random()),
        tilt_rad=(within(DEGREE, tilt), within(DEGREE, tilt)),
        ambient_c=24.0 + within(4.0),
        lost_rate=float(random.uniform(0.0, 0.005)),
        clock_ppm=within(60.0),
        sense_v={},
    )


def _sense(scene: Scene, random: np.random.Generator) -> dict[str, float]:
    """What voltage registers show too much [V]: of a batch of servos, and of each of them."""
    volts = float(scene.robot.document["supply"]["voltage_v"]["value"])
    joints = list(scene.robot.by_joint)
    off = SENSE[0] * random.uniform(-1.0, 1.0) + SENSE[1] * random.uniform(-1.0, 1.0, len(joints))
    return dict(zip(joints, (volts * off).tolist(), strict=True))


@dataclass(frozen=True)
class LeggedCase:
    """What is true of one case on a scene."""

    seed: int
    asked: Asked
    kind: Kind
    concealment: Concealment
    scene: Scene
    hidden: tuple[LeggedHidden, ...]
    ordinary: tuple[LeggedHidden, ...]
    nuisances: LeggedNuisances
    decoy: Mapping[str, float]  #: zero errors of joints that draw the eye [rad]
    style: str  #: what the robot's program reads, one of :data:`READS`

    def truth(self, plan: Plan) -> tuple[Whole, list[tuple[LeggedHidden, Truth]]]:
        """The robot under a plan, and what is true of every effect in it."""
        whole = self.nuisances.on(believed(self.scene, plan))
        zero = {**self.nuisances.zero_rad, **self.decoy}
        whole = whole.electrics_but(zero_rad=zero)
        found = []
        for hidden in (*self.ordinary, *self.hidden):
            whole, truth = hidden.on(whole)
            found.append((hidden, truth))
        return whole, found


def stance_share(scene: Scene, told: Sequence[LeggedHidden]) -> float | None:
    """Share of what effects together change that is in stance.

    ``None`` without an effect, and where nothing walks.
    """
    if not told or not scene.walks:
        return None
    changed = {}
    for group in scene.groups:
        whole = believed(scene, group.plan)
        for hidden in told:
            whole, _ = hidden.on(whole)
        changed[group.name] = whole
    return standing_share(base(scene.name), tracks(scene, changed))


def _size(scene: Scene, effect: LeggedEffect, wanted: float, where: Where) -> LeggedHidden | None:
    """The size that has about a ratio, by a few tries; ``None`` where none plausible has."""
    size, tried = effect.typical, []
    for _ in range(TRIES):
        now = legged_ratio(scene.name, effect.name, size, where)
        tried.append((abs(math.log(max(now, 1e-6) / wanted)), size, now))
        if abs(now / wanted - 1.0) < CLOSE:
            break
        faster = min(max(wanted / max(now, 1e-6), 0.1), 6.0)
        size = min(max(size * faster, effect.least), effect.most)
        if any(size == before for _, before, _ in tried):
            break
    off, best, now = min(tried)
    if off > math.log(FAR):
        return None
    return LeggedHidden(effect.name, best, now, wanted, where)


def draw_legged(seed: int, asked: Asked) -> LeggedCase:
    """Draw a case on the scene ``asked.rig``. Raises ``ValueError`` as :func:`draw` does."""
    scene = SCENES[str(asked.rig)]
    random = np.random.default_rng([seed, 22])
    shares = {k: s for k, s in SHARES.items() if k is not Kind.STRANGER}
    weights = np.array(list(shares.values()))
    at = int(random.choice(len(shares), p=weights / weights.sum()))
    kind = Kind(asked.kind) if asked.kind else list(shares)[at]
    if asked.style and asked.style not in READS:
        raise ValueError(f"no style {asked.style!r} on {scene.name}: one of {'; '.join(READS)}")
    if kind is Kind.STRANGER:
        raise ValueError("strangers are hidden on one-joint rigs: leave the scene out")
    for _ in range(DRAWS):
        case = _try(seed, asked, scene, kind, random)
        if case is not None:
            return case
    raise ValueError(
        f"no case in {DRAWS} draws: {', '.join(asked.effects) or kind.value} does not reach "
        f"the ratio asked for on {scene.name}: ask for a smaller one"
    )


def _try(
    seed: int, asked: Asked, scene: Scene, kind: Kind, random: np.random.Generator
) -> LeggedCase | None:
    options = [Concealment.PLAIN, Concealment.MASKED, Concealment.RARE]
    concealment = options[int(random.integers(3))] if kind is not Kind.NULL else Concealment.PLAIN
    if asked.concealment:
        concealment = Concealment(asked.concealment)
    if concealment not in options:
        raise ValueError(f"a legged case is not {concealment.value}: plain, masked or rare")
    hidden = []
    for name in _chosen(asked, scene, kind, concealment, random):
        effect = LEGGED[name]
        wanted = asked.ratio or float(random.choice(RATIOS))
        legs = [leg["name"] for leg in scene.robot.document["leg"]]
        legs = list(scene.legs) or legs
        if concealment is Concealment.RARE and effect.scoped:
            legs = [str(random.choice(legs))]
        sign = int(random.choice([-1, 1])) if effect.signed else 1
        found = _size(scene, effect, wanted, Where(sign, tuple(legs)))
        if found is None:
            return None
        hidden.append(found)
    ordinary: list[LeggedHidden] = []
    if concealment is Concealment.MASKED:
        every = tuple(leg["name"] for leg in scene.robot.document["leg"])
        sign = int(random.choice([-1, 1]))
        spare = [n for n in ("gain_error", "link_mass") if n not in {h.name for h in hidden}]
        ordinary.append(LeggedHidden(spare[0], 0.10, math.nan, math.nan, Where(sign, every)))
    pins = {pin for h in (*hidden, *ordinary) for pin in h.effect.pins}
    nuisances = _nuisances(scene, random, pins)
    decoy: dict[str, float] = {}
    if random.random() < 0.3 if asked.disguise is None else asked.disguise:
        joint = str(random.choice(list(scene.joints)))
        decoy[joint] = float(random.choice([-1.0, 1.0])) * 2.0 * DEGREE
    style = asked.style or str(random.choice(list(READS), p=READ))
    if scene.support != "ground":
        style = next(iter(READS))
    nuisances = dataclasses.replace(nuisances, sense_v=_sense(scene, random))
    return LeggedCase(
        seed,
        asked,
        kind,
        concealment,
        scene,
        tuple(hidden),
        tuple(ordinary),
        nuisances,
        decoy,
        style,
    )


def _chosen(
    asked: Asked, scene: Scene, kind: Kind, concealment: Concealment, random: np.random.Generator
) -> list[str]:
    count = COUNT.get(kind, 1)
    standing = scene.support == "suspended"
    fitting = [n for n, e in LEGGED.items() if e.standing or not standing]
    if asked.effects:
        if len(asked.effects) != count:
            raise ValueError(f"a case of kind {kind.value} has {count} effects: name so many")
        if missing := sorted(set(asked.effects) - set(fitting)):
            raise ValueError(f"{scene.name} cannot hide {', '.join(missing)}: {', '.join(fitting)}")
        return list(asked.effects)
    if concealment is Concealment.RARE:
        fitting = [name for name in fitting if LEGGED[name].scoped]
    return [fitting[i] for i in random.permutation(len(fitting))[:count]]


def nuisance_document(nuisances: LeggedNuisances) -> dict[str, Any]:
    """For the key."""
    return dataclasses.asdict(nuisances)
