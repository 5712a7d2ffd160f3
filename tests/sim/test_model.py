"""Effects in robot files: read, checked, applied, written back."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from sim_rigs import changed

from busemu.tables import Robot, RobotError, load_robot
from busemu.tables.robots import parse_robot
from sim.effects import effect
from sim.model import Addition, Estimate, additions, effect_tables, read_model, with_additions
from sim.robot import read_physics
from sim.world import BulletPlant

PLAY = {
    "name": "backlash",
    "where": ["leg1.tibia", "leg2.tibia"],
    "parameters": {
        "width_rad": {"value": 0.011, "ci95": [0.01, 0.012], "source": "walk-1, walk-2"},
    },
}


def with_effect(*tables: Any, robot: str = "marvin") -> Robot:
    return changed(load_robot(robot), "effect", to=list(tables))


def test_an_effect_of_the_file_acts_where_it_says_and_nowhere_else() -> None:
    model = read_model(with_effect(PLAY))
    for joint in model.joints:
        wanted = 0.011 if joint.name in PLAY["where"] else 0.0
        assert joint.drive.backlash_rad == wanted


def test_without_a_place_an_effect_acts_everywhere() -> None:
    model = read_model(with_effect({**PLAY, "where": []}))
    assert {joint.drive.backlash_rad for joint in model.joints} == {0.011}


def test_the_base_physics_knows_nothing_of_effects() -> None:
    assert read_physics(with_effect(PLAY)) == read_physics(load_robot("marvin"))
    assert read_model(load_robot("marvin")) == read_physics(load_robot("marvin"))


def test_effects_act_one_after_the_other_on_the_condition() -> None:
    wrong = {
        "name": "supply_voltage",
        "parameters": {"scale": {"value": 0.9, "source": "assumed"}},
    }
    robot = with_effect(wrong, wrong, robot="pendulum")
    model = read_model(robot, condition={"supply_v": 10.0})
    assert model.supply.voltage_v == pytest.approx(8.1)


def test_a_parameter_left_out_is_off() -> None:
    kind = effect("stribeck_friction")
    known = kind.parameters[0]
    one = Addition(kind, (), {known.name: Estimate(known.typical, "assumed")})
    rest = {p.name: p.off for p in kind.parameters[1:]}
    assert one.values == {known.name: known.typical, **rest}


def test_the_emulator_runs_the_model_of_the_file() -> None:
    plant = BulletPlant(with_effect(PLAY))
    assert plant.robot == read_model(with_effect(PLAY))
    plant.close()


def test_what_is_written_back_is_read_the_same(tmp_path: Path) -> None:
    found = (
        Addition(effect("backlash"), ("leg3.femur",), {"width_rad": Estimate(0.02, "walk-3")}),
        Addition(
            effect("foot_compliance"),
            ("leg1",),
            {
                "stiffness_n_m": Estimate(2400.0, "walk-3", (2150.0, 2700.0)),
                "damping_n_s_m": Estimate(3.0, "walk-3", (1.0, 5.0)),
            },
        ),
    )
    path = tmp_path / "model.toml"
    document = with_additions(with_effect(PLAY), found)
    path.write_text(tomli_w.dumps(document), "utf-8")
    back = load_robot(path)
    assert additions(back)[1:] == found
    assert tomllib.loads(path.read_text("utf-8"))["effect"][1:] == effect_tables(found)
    assert read_model(back) == found[1].to(found[0].to(read_model(with_effect(PLAY))))


def test_units_are_written_and_must_be_the_catalogues() -> None:
    (table,) = effect_tables(additions(with_effect(PLAY)))
    assert table["parameters"]["width_rad"]["unit"] == "rad"
    table["parameters"]["width_rad"]["unit"] = "deg"
    with pytest.raises(RobotError, match="width_rad is in rad, not deg"):
        read_model(with_effect(table))


def parameters(**width: Any) -> dict[str, Any]:
    return {**PLAY, "parameters": {"width_rad": width}}


SAG = {"name": "voltage_sag", "parameters": {"resistance_ohm": {"value": 0.5, "source": "a"}}}
SKEW = {"name": "read_skew", "parameters": {"skew_s": {"value": 0.005, "source": "a"}}}
REFUSED = {
    "a place for what acts on the whole robot": (
        {**SAG, "where": ["leg1"]},
        "effect voltage_sag acts on the whole robot, not on 'leg1': leave where away",
    ),
    "a place for what acts on the bus": (
        {**SKEW, "where": ["leg1.tibia"]},
        "effect read_skew acts on the whole bus, not on 'leg1.tibia': leave where away",
    ),
    "out of bounds, by its effect": (
        parameters(value=0.5, source="a"),
        "effect backlash: width_rad = 0.5 rad is not within 0 to 0.25 rad",
    ),
    "unknown place, and which there are": (
        {**PLAY, "where": ["leg7.tibia"]},
        "use leg1.coxa, leg1.femur, leg1.tibia, leg2.coxa,",
    ),
    "unknown effect": ({**PLAY, "name": "blacklash"}, "no effect named 'blacklash'"),
    "unknown place": ({**PLAY, "where": ["leg7.tibia"]}, "no joint 'leg7.tibia'"),
    "unknown parameter": (
        {**PLAY, "parameters": {"play_rad": {"value": 0.1, "source": "a"}}},
        "no parameter 'play_rad'",
    ),
    "out of bounds": (parameters(value=0.5, source="a"), "width_rad = 0.5 rad is not within 0 to"),
    "not a number": (parameters(value=math.nan, source="a"), "nan rad"),
    "text": (parameters(value="wide", source="a"), "number in rad"),
    "no source": (parameters(value=0.01), "source"),
    "empty source": (parameters(value=0.01, source=""), "needs a source"),
    "interval upside down": (
        parameters(value=0.01, source="a", ci95=[0.02, 0.01]),
        "low beyond high",
    ),
    "half an interval": (parameters(value=0.01, source="a", ci95=[0.02]), "[low, high]"),
    "misspelt key": ({**PLAY, "wehre": []}, "wehre"),
    "no parameters": ({"name": "backlash"}, "parameters"),
    "place that is no list": ({**PLAY, "where": "leg1.tibia"}, "list of names"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_effects_that_cannot_be_are_refused_with_one_line(case: str) -> None:
    table, says = REFUSED[case]
    with pytest.raises(RobotError) as caught:
        read_model(with_effect(table))
    assert says in str(caught.value)
    assert "marvin.toml: [effect][0]" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_gear_that_friction_jams_is_refused_with_what_it_comes_to() -> None:
    sticky = {"name": "load_friction", "parameters": {"ratio": {"value": 0.6, "source": "a"}}}
    read_model(with_effect(sticky))
    with pytest.raises(RobotError, match=r"friction takes 1\.2 \(ratio\) of the motor's torque"):
        read_model(with_effect(sticky, sticky))


def test_an_effect_of_legs_is_refused_on_a_robot_without_legs() -> None:
    grip = {"name": "foot_slip", "parameters": {"scale": {"value": 0.5, "source": "assumed"}}}
    document = {**load_robot("pendulum").document, "effect": [grip]}
    with pytest.raises(RobotError, match="foot_slip: pendulum has no leg"):
        read_model(parse_robot(document, Path("pendulum.toml")))


def test_values_out_of_bounds_are_refused_when_the_file_is_read() -> None:
    with pytest.raises(RobotError, match=r"0\.5 rad is not within"):
        additions(with_effect(parameters(value=0.5, source="a")))
