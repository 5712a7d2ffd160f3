"""The page of a diagnosis, and what it says at the terminal."""

import io
import math
import os
import re
from dataclasses import replace
from datetime import date
from html.parser import HTMLParser

import numpy as np
import pytest
from rich.console import Console

from bench import motions
from bench.diagnosis.joint.nuisances import NUISANCES
from bench.diagnosis.report import Origin, Trace, report_page, write_report
from bench.diagnosis.report.pictures import (
    CLOSE_S,
    MOST_JOINTS,
    motion_picture,
    regime_picture,
    worst_stretch,
)
from bench.diagnosis.report.telling import (
    cautions,
    channel_finding,
    headline,
    remains,
    unfinished,
)
from bench.diagnosis.report.telling import (
    worse as denied,
)
from bench.diagnosis.report.traces import typical, worst
from bench.diagnosis.report.words import MOTIONS, TOLERANCES, meaning
from bench.diagnosis.result import (
    VERDICTS,
    Cause,
    Diagnosis,
    Estimate,
    FitSummary,
    NextExperiment,
    Rival,
)
from bench.diagnosis.summary import show
from sim.effects import catalogue

SECTIONS = ("next", "motion", "where", "path", "causes", "ranking", "pairs", "left", "limits")
SECTIONS += ("model", "how")
VOID = {"meta", "br", "use", "path", "link", "img"}
ORIGIN = Origin("rig", "A rig", ("one", "two"), ("punch",), 3, date(2026, 1, 2), "out/model.toml")

SETTINGS = {
    "motion": "dither",
    "arguments": {"amplitude_rad": 0.02, "lift_s": 2.0, "hz": 1.2, "steps": [1, 2]},
    "registers": {"p_gain": 16, "torque_enable": 1},
    "payload_kg": 0.325,
    "warm_start_s": 0.0,
}
TOLD = (
    "dither, a small triangle to and fro around several places (amplitude 1.15°, lift 2 s, "
    "at 1.2 Hz, steps 1 2, p gain 16, payload 0.325 kg)"
)
CAUSE = Cause(
    effect="backlash",
    scope=("arm",),
    parameters={
        "width_rad": Estimate(0.0105, (0.0098, 0.0112), "rad"),
        "other_s": Estimate(0.012, (0.0, 0.5), "s", "trade-off with gain"),
    },
    held_out_gain_nats=812.0,
    explained_share=0.87,
    probability=0.9,
    indistinguishable_from=(Rival("dead_zone", ("arm",), 0.08, 2.5),),
)
FOUND = Diagnosis(
    verdict="partly_explained",
    mismatch=(
        {"channel": "present_position", "joints": ["arm"], "phase": "reversal", "share": 0.41,
         "p_value": 1e-5, "time_share": 0.1},
    ),
    causes=(CAUSE,),
    fit=FitSummary(0.021, 0.0042, 0.0031, True, ("swing", "ramp")),
    unexplained=(
        {"joints": ["arm"], "predictable_rad": 0.002, "share": 0.3, "where": ["at_rest"],
         "terms": {"velocity": -0.4}},
    ),
    next_experiment=(
        NextExperiment("dither", SETTINGS, ("backlash", "dead_zone"), 0.95),
    ),
    limits=("no voltage register was read",),
    channels=(
        {"channel": "position", "judges": "all", "rms_before": 0.02, "rms_after": 0.004,
         "rounding": 0.0005, "noise": 0.003},
        {"channel": "duty", "judges": "the controller", "rms_before": 0.003, "rms_after": 0.003,
         "rounding": 0.0003, "noise": 0.0004},
    ),
    rejected=(
        {"effect": "voltage_sag", "because": "the voltage register says 0.15 ohm"},
        {"effect": "punch", "channel": "duty", "wanted": 1.9},
    ),
    ranking=(
        {"effect": "backlash", "with": [], "gain_nats": 90.0, "inflation": 3.0,
         "deflated_nats": 30.0},
        {"effect": "punch", "with": ["backlash"], "gain_nats": -2.0, "inflation": 1.0,
         "deflated_nats": -2.0},
    ),
    details={
        "rollouts": 12345,
        "noise": {"position": {"white": 0.001, "coloured": 0.002, "memory_s": 0.05}},
        "nuisances": {"zero": {"value": 0.01, "deviations": 1.0, "unit": "rad"}},
    },
)  # fmt: skip
BARE = Diagnosis("consistent", (), (), FitSummary(0.003, 0.003, 0.003, False, ("a",)), (), (), ())


def trace(name="swing", joint="arm", size=0.02, at_s=3.0, count=300):
    """A sine that the model misses by a bump, of which a tenth is left."""
    t = np.linspace(0.0, 6.0, count)
    measured = 0.5 * np.sin(2.0 * t)
    bump = size * np.exp(-(((t - at_s) / 0.2) ** 2))
    parts = {"at_rest": np.abs(np.cos(2.0 * t)) < 0.3, "late": t > 4.5}
    return Trace(
        name, name, joint, t, measured + 0.05, measured, measured - bump, measured - 0.1 * bump,
        parts,
    )  # fmt: skip


TRACES = (trace("swing"), trace("ramp", size=0.04))


class Parts(HTMLParser):
    """Elements that are left open, ids, references, and the text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.wrong, self.ids, self.seen, self.text = [], [], [], set(), ""
        self.attributes = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.seen.add(tag)
        self.attributes += [(tag, key, value or "") for key, value in attrs]
        self.ids += [value for key, value in attrs if key == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag in VOID:
            return
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def page():
    return report_page(FOUND, TRACES, ORIGIN)


@pytest.fixture(scope="module")
def parts(page):
    return Parts(page)


def cells(page):
    """The text with a space between any two cells."""
    return " ".join(re.sub("<[^>]+>", " ", page).split())


def printed(diagnosis):
    console = Console(file=io.StringIO(), width=400)
    show(diagnosis, console, [], "out/model.toml")
    return console.file.getvalue()


def test_every_element_is_closed(parts):
    assert not parts.open
    assert not parts.wrong


def test_ids_are_unique_and_references_lead_somewhere(page, parts):
    assert len(parts.ids) == len(set(parts.ids))
    targets = re.findall(r'(?:href="#|url\(#)([^")]+)', page)
    assert targets
    assert set(targets) <= set(parts.ids)


def test_nothing_is_fetched_from_elsewhere(page, parts):
    assert "://" not in page
    assert "@import" not in page
    assert not parts.seen & {"script", "link", "img", "iframe", "object", "base"}
    assert not [row for row in parts.attributes if row[1] in ("src", "srcset", "data")]
    assert all(value.startswith("#") for _, key, value in parts.attributes if key == "href")


def test_pictures_take_the_colours_of_the_page(page):
    drawn = re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL)
    assert len(drawn) == 5  # worst, typical, parts, time, recordings
    for picture in drawn:
        assert not re.findall(r"#[0-9a-fA-F]{6}\b", picture)
    names = set(re.findall(r"var\((--[a-z]+)\)", page))
    style = page[page.index("<style>") : page.index("</style>")]
    light, dark = style.split("prefers-color-scheme: dark", 1)
    for name in names - {"--face"}:
        assert f"{name}:" in light
        assert f"{name}:" in dark


@pytest.mark.parametrize("diagnosis", [replace(FOUND, verdict=v) for v in VERDICTS] + [BARE])
def test_every_verdict_has_every_part(diagnosis):
    told = Parts(report_page(diagnosis, TRACES[:1], ORIGIN))
    assert set(SECTIONS) <= set(told.ids)
    assert not told.open
    assert diagnosis.verdict.replace("_", " ") in told.text


def test_the_page_says_what_was_found(parts):
    text = " ".join(parts.text.split())
    for words in (
        "backlash of arm (missing; explains 87 %), or dead zone: not told apart",
        "0.0105 rad (0.602°)",
        "0.0098 to 0.0112 rad",
        "trade-off with gain",
        "arm after a reversal: 41 % of the misfit in 10 % of the time (p < 0.001)",
        "voltage sag: the voltage register says 0.15 ohm",
        "punch: channel duty, wanted 1.9",
        "no voltage register was read",
        "12,345 rollouts",
        "never considered: punch",
        "busemu serve --robot out/model.toml",
    ):
        assert words in text


def test_a_parameter_that_recordings_cannot_show_has_no_size():
    blind = {"size_m": Estimate(0.0, (-0.1, 0.1), "m", "dead"), **CAUSE.parameters}
    told = replace(FOUND, causes=(replace(CAUSE, parameters=blind),))
    for text in (printed(told), Parts(report_page(told, TRACES, ORIGIN)).text):
        (line,) = [line for line in text.splitlines() if "cannot be seen" in line]
        assert "0.1" not in line
        assert "-0.1 to 0.1" not in text
        assert "0.0098 to 0.0112 rad" in text


def test_a_pair_comes_with_the_experiment_that_separates_it(page):
    pairs = page[page.index('id="pairs"') : page.index('id="left"')]
    assert TOLD in pairs
    other = replace(FOUND.next_experiment[0], separates=("backlash", "punch"))
    page = report_page(replace(FOUND, next_experiment=(other,)), TRACES, ORIGIN)
    pairs = page[page.index('id="pairs"') : page.index('id="left"')]
    assert "no experiment was worked out" in pairs


def test_it_is_said_where_no_experiment_would_tell_much():
    little = replace(FOUND.next_experiment[0], power=0.54)
    told = replace(FOUND, next_experiment=(little,))
    for text in (printed(told), Parts(report_page(told, TRACES, ORIGIN)).text):
        flat = " ".join(text.split())
        assert "with a chance of 54 %, which is little: of those that were tried none does" in flat
        assert "which is little" not in " ".join(printed(FOUND).split())


def test_it_is_said_where_a_weight_is_to_hang_or_that_there_is_none():
    def told(**weight):
        other = replace(FOUND.next_experiment[0], arguments={**SETTINGS, **weight})
        return " ".join(printed(replace(FOUND, next_experiment=(other,))).split())

    elsewhere = told(payload_kg=0.2, payload_at_m=0.055)
    assert "payload 0.2 kg, payload 55 mm from the axis" in elsewhere
    assert "no weight" in told(payload_kg=0.0)
    assert "weight" not in told()


def test_names_from_recordings_cannot_write_the_page():
    odd = trace("<b>&\"'</svg>")
    text = report_page(FOUND, (odd,), replace(ORIGIN, title="<script>alert(1)</script>"))
    told = Parts(text)
    assert not told.seen & {"script", "b>"}
    assert not told.open
    assert not told.wrong


def test_joints_have_panels_of_their_own():
    two = report_page(FOUND, (trace(joint="hip"), trace(joint="knee")), ORIGIN)
    regimes = two[two.index("regimes-figure") : two.index("By recording")]
    assert ">hip<" in regimes
    assert ">knee<" in regimes


def test_of_several_joints_each_has_its_own_ranking_and_details():
    row = {"before": 0.02, "after": 0.01, "noise_floor": 0.001, "verdict": "partly_explained"}
    row |= {"effects": ["backlash"]} | dict(FOUND.details)
    arm = replace(
        FOUND,
        ranking=tuple(
            dict(FOUND.ranking[0]) | {"joint": joint, "deflated_nats": nats}
            for joint, nats in (("wrist", 90.0), ("arm", 30.0))
        ),
        rejected=({"effect": "punch", "joint": "wrist", "because": "it must not"},),
        details={"joints": {"arm": row, "wrist": row | {"rollouts": 7, "effects": []}}},
    )
    text = " ".join(Parts(report_page(arm, TRACES[:1], ORIGIN)).text.split())
    ranking = text[text.rindex("Ranking of hypotheses") : text.rindex("What else it could be")]
    assert ranking.index("backlash of arm") < ranking.index("backlash of wrist")
    assert ranking.count(" named") == 1  # at the arm only: the wrist's is not among the causes
    assert "punch of wrist: it must not" in text
    told = cells(report_page(arm, TRACES[:1], ORIGIN))
    assert "arm 1.15° 0.573° 0.057° partly explained backlash" in told
    assert "wrist 1.15° 0.573° 0.057° partly explained nothing" in told
    assert "12,345 rollouts" in text
    assert "wrist 7 rollouts" in text


def test_a_hypothesis_that_was_fitted_twice_has_one_line():
    again = dict(FOUND.ranking[0]) | {"deflated_nats": 20.0}
    text = report_page(replace(FOUND, ranking=(again, *FOUND.ranking)), TRACES, ORIGIN)
    ranking = text[text.index('id="ranking"') : text.index('id="pairs"')]
    assert ranking.count("<td>backlash</td>") == 1
    assert '<td class="n">30.0</td>' in ranking


def test_what_is_next_to_nothing_has_no_line(page):
    ranking = page[page.index('id="ranking"') : page.index('id="pairs"')]
    assert "<td>punch</td>" not in ranking
    assert "1 more gained less than 1 nat" in ranking
    small = {"value": 1e-13, "deviations": 1e-11, "unit": "rad"}
    some = {
        "tilt": small,
        "link": {"value": -0.104, "deviations": -2.0, "unit": "(ratio)"},
        "gear_damping": {"value": math.log(2.0), "deviations": 0.5, "unit": "(logarithm)"},
    }
    details = dict(FOUND.details) | {"nuisances": some}
    text = cells(report_page(replace(FOUND, details=details), TRACES, ORIGIN))
    assert "mass of the link -10.4 % -2.0" in text
    assert "damping of the gear times 2 +0.5" in text
    assert "tilt of the stand" not in text[text.rindex("differs by") :]


@pytest.mark.parametrize("angular", [True, False])
def test_a_goal_that_is_no_angle_is_not_drawn(angular):
    one = trace()
    one = one if angular else replace(one, goal_rad=np.full(len(one.t_s), np.nan))
    names = [line.get_label() for line in motion_picture(one, 0.001).axes[0].lines]
    assert ("goal" in names) is angular


def test_every_tolerance_of_a_joint_and_every_motion_has_words():
    assert {nuisance.name for nuisance in NUISANCES} == set(TOLERANCES)
    assert set(motions.MOTIONS) == set(MOTIONS)


def test_of_many_joints_those_missed_by_most_are_shown():
    traces = [trace(joint=f"j{i}", size=0.01 * (i + 1)) for i in range(MOST_JOINTS + 2)]
    figure = regime_picture(traces, 0.001)
    shown = [axes.get_title(loc="left") for axes in figure.axes]
    assert shown == [f"j{i}" for i in reversed(range(2, MOST_JOINTS + 2))]


def test_a_name_that_does_not_hold_is_not_recommended():
    worse = replace(FOUND, fit=replace(FOUND.fit, after=2.0 * FOUND.fit.before))
    for told, said in ((FOUND, True), (worse, False)):
        for text in (report_page(told, TRACES, ORIGIN), printed(told)):
            assert ("use the better model" in text) is said
            assert ("misses by more than before" in text) is not said


@pytest.mark.parametrize(("times", "is_worse"), [(1.005, False), (1.02, True)])
def test_a_misfit_that_is_the_same_to_a_hundredth_is_not_worse(times, is_worse):
    after = times * FOUND.fit.before
    found = replace(FOUND, fit=replace(FOUND.fit, after=after), channels=())
    assert ("misses by more than before" in printed(found)) is is_worse
    assert ("does not hold on the others" in printed(found)) is is_worse


def test_a_name_that_explains_little_is_called_a_hint():
    for gain, hint in ((14.0, True), (16.0, False)):  # nats: more than tolerances are likely to do
        cause = replace(CAUSE, explained_share=0.02, held_out_gain_nats=gain)
        text = printed(replace(FOUND, causes=(cause,)))
        assert ("a hint at most" in text) is hint
        assert ("tolerances do that too" in text) is not hint
    assert "a hint at most" not in printed(FOUND)


def test_a_name_that_shows_in_another_register_is_no_hint():
    supply = {"channel": "voltage", "judges": "the supply", "rms_before": 0.17, "rms_after": 0.05,
              "rounding": 0.03, "noise": 0.05}  # fmt: skip
    sag = replace(CAUSE, effect="voltage_sag", explained_share=0.0)
    for times, hardly in ((1.001, True), (2.0, False)):
        fit = replace(FOUND.fit, after=times * FOUND.fit.before)
        text = printed(replace(FOUND, causes=(sag,), channels=(supply,), fit=fit))
        assert "a hint at most" not in text
        assert ("shows in the voltage register" in text) is hardly
        assert ("misses by more than before" in text) is not hardly


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_summary_begins_with_the_verdict(verdict):
    causes = () if verdict in ("consistent", "unexplained") else FOUND.causes
    text = printed(replace(FOUND, verdict=verdict, causes=causes))
    assert text.startswith(verdict.replace("_", " ").upper())
    assert ("backlash of arm" in text) is bool(causes)


def test_the_summary_says_what_to_do_next():
    text = printed(FOUND)
    assert f"record {TOLD}: tells backlash and dead zone apart" in text
    assert "it could also be dead zone (8 %)" in text
    assert "record more groups of motions" in printed(BARE)


def test_a_part_that_follows_its_law_is_cleared():
    duty = FOUND.channels[1]
    assert channel_finding(duty, FOUND).startswith("cleared")
    assert "too little to matter" in channel_finding(duty | {"noise": 0.003}, FOUND)
    supply = {"channel": "voltage", "rms_before": 0.15, "rms_after": 0.15, "rounding": 0.03}
    assert channel_finding(supply | {"noise": 0.04}, FOUND).startswith("cleared")


@pytest.mark.parametrize("channel", ["position", "duty", "voltage"])
def test_more_than_rounding_is_a_finding_only_where_the_verdict_finds_something_left(channel):
    off = {"channel": channel, "rms_before": 1.0, "rms_after": 1.0, "rounding": 1e-3, "noise": 1.0}
    nothing = replace(FOUND, verdict="consistent", causes=(), unexplained=())
    for after, left in (
        (1.0, "no better: "),
        (0.95, "a little better, but "),
        (0.5, "better, but "),
    ):
        row = off | {"rms_after": after}
        assert channel_finding(row, FOUND).startswith(left + "more than rounding")
        assert "more than rounding" not in channel_finding(row, nothing)
    assert "what was named" in channel_finding(off, FOUND)
    assert "what was named" not in channel_finding(off, replace(FOUND, causes=()))
    clear = {"position": "cleared"}.get(channel, "no fault is seen")
    assert channel_finding(off, nothing).startswith(clear)
    named = channel_finding(off, replace(FOUND, unexplained=()))
    assert "no fault is seen" not in named, "a cause may be a fault of this part"


def test_the_picture_looks_closely_where_the_model_is_farthest_off():
    for at_s in (0.2, 3.0, 5.8):
        start, end = worst_stretch(trace(at_s=at_s))
        assert start <= at_s <= end
        assert end <= start + CLOSE_S


def test_the_typical_recording_is_of_another_group_than_the_worst():
    first, other = trace("a", size=0.05), trace("b", size=0.01)
    twins = [replace(trace(f"a{i}", size=0.04), group="a") for i in range(4)]
    assert worst([other, first, *twins]) is first
    assert typical([other, first, *twins]) is other
    assert typical([first, *twins]) in twins
    assert typical([first]) is None


def test_an_effect_without_words_is_told_by_its_equation(monkeypatch):
    monkeypatch.setattr("bench.diagnosis.report.words.MEANINGS", {})
    assert meaning("backlash") == catalogue()["backlash"].equation


def test_a_page_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "report.html"
    path.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_report(path, FOUND, TRACES, ORIGIN)
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    assert path.read_text() == "old"


@pytest.mark.parametrize(
    ("details", "late"),
    [
        ({}, False),
        ({"stopped": "step 1"}, True),
        ({"joints": {"elbow": {}, "pitch": {"stopped": "step 2"}}}, True),
        ({"joints": {"elbow": {}}}, False),
    ],
)
def test_a_search_that_was_not_done_is_told_on_top(details, late):
    diagnosis = replace(FOUND, details=details)
    assert unfinished(diagnosis) is late
    assert any("The time was used up" in told for told in cautions(diagnosis)) is late


@pytest.mark.parametrize("leash", [0.0, 5.0])
def test_misfits_on_a_leash_are_told_to_be_that(leash):
    for details in ({"leash_rad_s": leash}, {"joints": {"elbow": {"leash_rad_s": leash}}}):
        told = cautions(replace(FOUND, details=details))
        assert any("swings by itself" in one for one in told) is (leash > 0.0)


@pytest.mark.parametrize("verdict", ["unexplained", "partly_explained"])
@pytest.mark.parametrize(("share", "repeats"), [(0.3, True), (0.0, False), (-0.5, False)])
def test_what_no_recording_foretells_of_another_is_not_said_to_repeat(verdict, share, repeats):
    left = dict(FOUND.unexplained[0]) | {"share": share}
    diagnosis = replace(FOUND, verdict=verdict, unexplained=(left,))
    assert ("repeats" in headline(diagnosis)) is repeats
    assert ("could be foretold" in remains(left)) is repeats
    assert ("do not agree" in remains(left)) is not repeats


@pytest.mark.parametrize("by_shaking", [False, True])
def test_samples_deny_a_name_but_not_play_that_joints_shake_by(by_shaking):
    fit = replace(FOUND.fit, before=0.012, after=0.018)
    told = replace(FOUND, fit=fit, details={"shaking": {"named": by_shaking}})
    (first, *_) = cautions(told)
    assert ("neither the name nor its numbers hold there" in first) is not by_shaking
    assert ("Play shows in how much joints shake" in first) is by_shaking
    assert denied(told) is not by_shaking
