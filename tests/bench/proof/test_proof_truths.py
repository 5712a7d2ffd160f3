"""The translation of keys: every hidden effect in the catalogue's own parameters."""

import pytest
from judged_cases import tells

from bench.blind.changes import Setting
from bench.blind.drafts import parameters
from bench.blind.effects import EFFECTS
from bench.blind.rigs import RIGS
from bench.proof.truths import TABLE, error_of, true_parameters

RIG = "xl330-pendulum"


def told(name, size, sign=1):
    _, truth = EFFECTS[name].apply(RIGS[RIG].specimen(), size, Setting(sign))
    return {"effect": name, "parameters": parameters(truth)}


@pytest.mark.parametrize("name", EFFECTS)
def test_a_typical_hidden_effect_is_told_in_the_catalogues_words(name):
    tells(told(name, EFFECTS[name].typical), RIG)


def test_every_effect_that_can_be_hidden_is_in_the_table():
    assert set(TABLE) == set(EFFECTS)


def test_a_stranger_has_no_parameters_in_the_catalogue():
    assert true_parameters({"effect": "cogging", "parameters": {}}, RIG) == {}


def test_quantities_are_translated():
    def main(name, size, sign=1):
        return next(iter(true_parameters(told(name, size, sign), RIG).values())).value

    assert main("joint_compliance", 0.05) == pytest.approx(0.05)
    assert main("read_skew", 0.01) == pytest.approx(-0.01)
    assert main("supply_voltage", 0.1, -1) == pytest.approx(0.87)  # 10 % beyond the nuisance's 3 %
    sheet = RIGS[RIG].sheet
    assert main("rotor_inertia", 2.0 * sheet.armature_kg_m2) == pytest.approx(3.0)


def test_the_sign_of_a_zero_is_that_of_what_is_shown():
    specimen, _ = EFFECTS["zero_offset"].apply(RIGS[RIG].specimen(), 0.05, Setting(1))
    hidden = told("zero_offset", 0.05)
    # the generator shows the true angle less its zero, the catalogue adds the offset
    assert true_parameters(hidden, RIG)["offset_rad"].value == -specimen.sensing.zero_rad


def test_an_error_is_a_share_of_the_way_from_off_or_of_a_limit():
    limit = true_parameters(told("velocity_limit", 0.5), RIG)["limit_rad_s"]
    assert limit.value == pytest.approx(2.0)
    assert error_of(limit, 2.2) == pytest.approx(0.1)
    mass = true_parameters(told("link_mass", 0.2), RIG)["scale"]
    assert error_of(mass, mass.value + 0.025) == pytest.approx(0.1)
