"""Joints and legs in few words."""

from types import SimpleNamespace

import pytest

from bench.diagnosis.report.telling import measured, named
from bench.diagnosis.report.words import in_few, number, placed

SEGMENTS = ("coxa", "femur", "tibia")


def joints(legs, segments=SEGMENTS):
    return [f"leg{n}.{segment}" for n in legs for segment in segments]


@pytest.mark.parametrize(
    ("names", "told"),
    [
        ([], ""),
        (["shoulder"], "shoulder"),
        (joints([2]), "leg2.coxa, leg2.femur and leg2.tibia"),
        (joints(range(1, 7)), "coxa, femur and tibia of leg1 to leg6"),
        (joints(range(1, 7), ["tibia"]), "tibia of leg1 to leg6"),
        (joints([1, 2, 5, 6], ["femur"]), "femur of leg1, leg2, leg5 and leg6"),
        ([f"leg{n}" for n in range(1, 7)], "leg1 to leg6"),
        (
            [*joints([1, 2, 3], ["femur"]), *joints([3], ["tibia"])],
            "femur of leg1 and leg2 and femur and tibia of leg3",
        ),
        (["a", "b", "c", "d", "e"], "a, b, c, d and e"),
        ([*joints([1]), "trunk"], "leg1.coxa, leg1.femur, leg1.tibia and trunk"),
        (["leg10.tibia", *joints([7, 8, 9], ["tibia"])], "tibia of leg7 to leg10"),
    ],
)
def test_many_joints_of_legs_are_told_in_few_words(names, told):
    assert in_few(names) == told


@pytest.mark.parametrize(
    ("value", "told"),
    [(1535.97, "1540"), (0.17524, "0.175"), (62.0, "62"), (1.2345e7, "1.23e+07"), (2e-6, "2e-06")],
)
def test_numbers_of_thousands_are_told_as_people_write_them(value, told):
    assert number(value) == told


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        (["y_m"], "com offset of trunk in y"),
        (["x_m", "z_m"], "com offset of trunk"),
        (["mass_kg"], "com offset of trunk"),
    ],
)
def test_a_cause_in_one_direction_is_told_with_it(parameters, told):
    cause = SimpleNamespace(
        effect="com_offset", scope=["trunk"], parameters=dict.fromkeys(parameters)
    )
    assert named(cause) == told


@pytest.mark.parametrize(
    ("channel", "value", "told"),
    [
        ("position", 0.01, "0.573°"),
        ("lean", 0.01, "0.573°"),
        ("height", 0.01, "0.01 m"),
        ("voltage", 0.2, "0.2 V"),
        ("duty", 0.2, "20 %"),
        ("shaking", 0.2, "0.2 "),
    ],
)
def test_a_deviation_is_told_in_the_unit_of_its_channel(channel, value, told):
    assert measured({"channel": channel, "rms_after": value}, "rms_after") == told


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("gain_error@all", "gain error"),
        ("backlash@femur", "backlash of femur"),
        ("com_offset.x@trunk", "com offset in x of trunk"),
        ("zero_offset@leg3.femur", "zero offset of leg3.femur"),
        ("dead_zone", "dead zone"),
    ],
)
def test_an_effect_at_a_place_is_told_in_words(name, told):
    assert placed(name) == told
