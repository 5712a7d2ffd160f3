"""What of an effect in a robot that walks no nuisance within its tolerance can imitate."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from bench.blind import Asked, legged_case, legged_imitation
from bench.blind.case import Concealment, Kind
from bench.blind.imitation import Free
from bench.blind.legged_case import TOLERANCES, LeggedCase, LeggedHidden, LeggedNuisances
from bench.blind.legged_effects import Where, Whole
from bench.blind.legged_imitation import Granted, legged_left, moved
from bench.blind.legged_sizing import BEGINNING_S, END_S, Track
from bench.blind.scenes import OBSERVE_S, SCENES, Scene

FLOOR = 0.5
LEGS = tuple(f"leg{n}" for n in range(1, 7))
JOINTS = tuple(SCENES["marvin-walk"].robot.by_joint)


def nuisances() -> LeggedNuisances:
    def each(name: str) -> dict[str, float]:
        return dict.fromkeys(JOINTS, TOLERANCES[name][0])

    return LeggedNuisances(
        link_mass=each("link_mass"),
        com_m=(0.0, 0.0, 0.0),
        zero_rad=each("zero_rad"),
        torque_factor=each("torque_factor"),
        friction_factor=each("friction_factor"),
        supply_factor=1.0,
        droop_v_s=0.0,
        tilt_rad=(0.0, 0.0),
        ambient_c=24.0,
        lost_rate=0.0,
        clock_ppm=0.0,
        sense_v={},
    )


def case(*hidden: LeggedHidden, scene: str = "marvin-walk") -> LeggedCase:
    return LeggedCase(
        seed=1,
        asked=Asked(),
        kind=Kind.SINGLE,
        concealment=Concealment.PLAIN,
        scene=SCENES[scene],
        hidden=hidden,
        ordinary=(),
        nuisances=nuisances(),
        decoy={},
        style="position",
    )


def hides(name: str, size: float, sign: int = 1) -> LeggedHidden:
    return LeggedHidden(name, size, 3.0, 3.0, Where(sign, LEGS))


def plain(scene: Scene, changed: Mapping[str, Whole]) -> Sequence[Track]:
    """A robot of which every joint shows its supply, its tibiae's mass and its trunk's weight.

    The supply shows as often as the gain of a joint has it.
    """
    volts = float(scene.robot.document["supply"]["voltage_v"]["value"])
    found = []
    for whole in changed.values():
        masses = whole.body.link_mass or {}
        gains = set((whole.electrics.gain_factor or {"any": 1.0}).values())
        (gain,) = gains
        shown = [
            10.0 * (gain * (whole.electrics.supply_v or volts) / volts - 1.0),
            *(masses.get(f"{leg}.tibia", 1.0) - 1.0 for leg in LEGS),
            3.0 * whole.body.payload_kg,
        ]
        count = round((BEGINNING_S + END_S) / OBSERVE_S) + 10
        angle = np.tile(np.array(shown), (count, 1))
        angle[: round(BEGINNING_S / OBSERVE_S)] *= 7.0  # standing up does not count
        found.append(Track(angle, angle > 0.0))
    return found


@pytest.fixture(autouse=True)
def played(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(legged_imitation, "tracks", plain)
    monkeypatch.setattr(legged_imitation, "legged_floor", lambda _: FLOOR)


def over_floor(change: float) -> float:
    """Of one column of the eight that a robot shows."""
    return float(abs(change) / np.sqrt(8.0) / FLOOR)


def test_a_supply_is_what_its_tolerance_leaves() -> None:
    left = legged_left(case(hides("supply_voltage", 0.1)), 0)
    assert left.ratio == pytest.approx(over_floor(10.0 * (0.13 - 0.015)), rel=1e-3)
    assert left.imitation["supply_factor"] == pytest.approx(1.015)


def test_a_supply_and_a_gain_may_be_granted_more() -> None:
    one = case(hides("supply_voltage", 0.1))
    left = legged_left(one, 0, Granted(supply=0.04))
    assert left.ratio == pytest.approx(over_floor(10.0 * (0.13 - 0.04)), rel=1e-3)
    left = legged_left(one, 0, Granted(supply=0.04, gain=0.05))
    assert left.ratio == pytest.approx(over_floor(10.0 * (1.13 - 1.04 * 1.05)), rel=1e-2)
    assert left.imitation["gain_factor"] == pytest.approx(1.05)


def test_a_gain_that_is_granted_is_beside_one_that_is_hidden() -> None:
    one = case(hides("gain_error", 0.1))
    whole, _ = one.truth(one.scene.groups[0].plan)
    gained = legged_imitation._gained(whole, 1.05).electrics.gain_factor
    assert gained == dict.fromkeys(JOINTS, pytest.approx(1.05 * 1.2))


def test_masses_of_links_imitate_no_payload() -> None:
    left = legged_left(case(hides("payload", 0.2)), 0)
    assert left.ratio == pytest.approx(over_floor(3.0 * 0.2), rel=1e-3)


def test_another_part_may_be_twice_as_large_and_no_larger() -> None:
    two = case(hides("payload", 0.2), hides("payload", 0.3))
    assert legged_left(two, 0).ratio == pytest.approx(0.0, abs=1e-3)
    two = case(hides("payload", 0.5), hides("payload", 0.3))
    left = legged_left(two, 0)
    assert left.ratio == pytest.approx(over_floor(3.0 * (0.8 - 0.6)), rel=1e-3)
    assert left.imitation["payload.size"] == pytest.approx(0.6)


def test_on_a_stand_all_of_a_track_counts() -> None:
    def rms(scene: str) -> float:
        return legged_left(case(hides("payload", 0.2), scene=scene), 0).ratio

    assert rms("marvin-leg") > 5.0 * rms("marvin-walk")


def test_every_number_that_moves_a_joint_is_free_and_is_moved() -> None:
    one = case(hides("payload", 0.2))
    free: list[Free] = list(legged_imitation._free(one))
    assert len(free) == 4 * len(JOINTS) + 3 + 1 + 2 + 1 + 1
    ends = moved(one, free, np.array([(f.high - f.now) / f.step for f in free]))
    for name, (middle, most) in TOLERANCES.items():
        value = getattr(ends.nuisances, name)
        every = value.values() if isinstance(value, dict) else np.atleast_1d(value)
        assert all(x == pytest.approx(middle + most) for x in every), name
    assert ends.nuisances.droop_v_s == legged_case.droop_most_v_s(one.scene)
    assert ends.hidden[0].size == pytest.approx(0.4)
    assert moved(one, free, np.zeros(len(free))) == one
    few = dataclasses.replace(one, hidden=(), ordinary=one.hidden)
    assert moved(few, list(legged_imitation._free(few)), np.zeros(len(free))) == few


def test_tolerances_are_drawn_to_their_ends_and_no_further() -> None:
    scene = SCENES["marvin-walk"]
    drawn = [legged_case._nuisances(scene, np.random.default_rng(n), set()) for n in range(40)]
    for name, (middle, most) in TOLERANCES.items():
        values = np.array(
            [
                list(value.values()) if isinstance(value, dict) else np.atleast_1d(value)
                for value in (getattr(one, name) for one in drawn)
            ]
        )
        assert values.max() <= middle + most
        assert values.min() >= middle - most
        assert np.ptp(values) > 1.8 * most, name
    volts = float(scene.robot.document["supply"]["voltage_v"]["value"])
    assert legged_case.droop_most_v_s(scene) == pytest.approx(volts / 1000.0)
    droop = [one.droop_v_s for one in drawn]
    assert 0.9 * legged_case.droop_most_v_s(scene) < max(droop) <= legged_case.droop_most_v_s(scene)
