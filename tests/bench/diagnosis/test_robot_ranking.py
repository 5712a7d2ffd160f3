"""What was tried of a whole robot, and what something else than the gait has shown, in a report."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_report_page import CAUSE, FOUND, ORIGIN, TRACES, cells, printed

from bench.diagnosis.report import report_page
from bench.diagnosis.report.telling import headline
from bench.diagnosis.robot.channels import LEFT_OUT, ranking
from bench.diagnosis.robot.fit import RobotFit
from bench.diagnosis.robot.gains import RobotFindings, RobotGain

RISE = "how the robot stands up"
SAG = replace(
    CAUSE, effect="voltage_sag", scope=(), explained_share=0.46, shown_by=RISE,
    indistinguishable_from=(),
)  # fmt: skip


def fit(*names):
    return RobotFit(names, np.zeros(1 + len(names)), {}, 0.0)


def gain(name, nats, *others):
    return RobotGain(name, fit(*others, name), nats, 2.0, None)


def rows(whole, beside=()):
    """Two steps: a gain and slip, then springs beside the gain."""
    steps = (
        (gain("gain_error@all", 60.0), gain("foot_slip@all", 1.0)),
        (gain("joint_compliance@femur", 40.0, "gain_error@all"),),
    )
    return ranking(RobotFindings(fit(), fit(), (), steps, {}, ()), whole, beside)


def table(diagnosis):
    text = report_page(diagnosis, TRACES, ORIGIN)
    return cells(text[text.index('id="ranking"') : text.index('id="pairs"')])


@pytest.mark.parametrize(
    ("whole", "named"),
    [
        (fit("gain_error@all"), [True, False, False]),
        (fit("gain_error@all", "joint_compliance@femur"), [True, False, True]),
        (fit("joint_compliance@femur"), [False, False, False]),
        (fit(), [False, False, False]),
    ],
)
def test_a_row_is_of_what_is_named_if_all_that_was_fitted_is(whole, named):
    assert [row["named"] for row in rows(whole)] == named


def test_a_report_tells_places_in_words_and_marks_what_is_named():
    told = table(replace(FOUND, ranking=rows(fit("gain_error@all"))))
    assert "gain error nothing 60.0 2.0 30.0 named" in told
    assert re.search(r"joint compliance of femur gain error 40\.0 2\.0 20\.0 (?!named)", told)
    assert "@" not in told
    assert "1 more gained less than 1 nat" in told


def test_what_has_no_name_is_told_why():
    why = "groups that were left out are no better with it"
    steps = ((gain("gain_error@all", 60.0), replace(gain("foot_slip@all", 40.0), because=why)),)
    found = RobotFindings(fit(), fit(), (), steps, {}, ())
    some = ranking(found, fit("gain_error@all"))
    assert [row.get("because") for row in some] == [None, why]
    assert f"foot slip nothing 40.0 2.0 20.0 {why}" in table(replace(FOUND, ranking=some))
    back = "recordings that were not used to fit are no better with it"
    assert [row["because"] for row in ranking(found, fit())] == [LEFT_OUT, why]
    some = ranking(found, fit(), (), {"gain_error@all": back, "foot_slip@all": back})
    assert [row["because"] for row in some] == [back, why]
    assert f"gain error nothing 60.0 2.0 30.0 {back}" in table(replace(FOUND, ranking=some))


@pytest.mark.parametrize("kept", [("gain_error@all",), ()])
def test_what_something_else_has_shown_is_among_what_was_fitted(kept):
    """It is named also where a name that it was fitted beside is taken back for it."""
    whole = fit(*kept, "voltage_sag@all")
    sag = gain("voltage_sag@all", 90.0, "gain_error@all")
    *_, row = rows(whole, [(sag, RISE)])
    assert (row["named"], row["shown_by"]) == (True, RISE)
    told = table(replace(FOUND, causes=(SAG,), ranking=rows(whole, [(sag, RISE)])))
    assert f"voltage sag, by {RISE} gain error 90.0" in told


def test_where_nothing_gained_a_report_says_so_and_not_that_nothing_was_fitted():
    nothing = tuple(dict(row) | {"deflated_nats": -3.0} for row in rows(fit()))
    assert "None of 3 that were fitted gained as much as 1 nat" in table(
        replace(FOUND, ranking=nothing)
    )
    assert "No hypothesis was fitted" in table(replace(FOUND, ranking=()))


def test_the_share_of_what_something_else_shows_is_not_of_the_misfit():
    diagnosis = replace(FOUND, causes=(SAG, CAUSE))
    assert f"voltage sag (missing; explains 46 % of {RISE})" in headline(diagnosis)
    assert f"explains 46 % of {RISE}, held-out gain 812 nats" in printed(diagnosis)
    text = cells(report_page(diagnosis, TRACES, ORIGIN))
    own = text[text.index("It explains 46 %") :]
    own = own[: own.index("parameter")]
    assert own.startswith(f"It explains 46 % of {RISE} on 2 recordings not used to fit, which")
    assert "likelier by 812 nats" in own
    assert "left out of the fit in turn" not in own
    assert "It explains 87 % of what can be explained (the squared misfit above the floor" in text


def test_a_document_tells_what_a_cause_was_shown_by_if_not_by_positions():
    first, second = replace(FOUND, causes=(SAG, CAUSE)).document()["causes"]
    assert first["shown_by"] == RISE
    assert "shown_by" not in second
