"""What may be named of a whole robot: what is asked in which order, and what is taken back."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.robot.fit import RobotFit
from bench.diagnosis.robot.gains import NEEDED, RobotFindings, RobotGain
from bench.diagnosis.robot.model import RATTLING
from bench.diagnosis.robot.naming import Answer, Named, Naming
from bench.diagnosis.robot.rattling import Shaker, is_play, is_spring
from bench.diagnosis.robot.rising import Riser
from bench.diagnosis.robot.settling import (
    AS_WELL,
    ASSUMED,
    DRIVEN,
    NO_BETTER,
    NO_SIZE,
    OTHER_VOLTS,
    STANDS_IN,
    UNSURE,
)
from bench.diagnosis.watch import OutOfTimeError
from sim.effects import effect

PLAY, SAG = "backlash@all", "voltage_sag@all"
GAIN, SPRINGS = "gain_error@all", "foot_compliance@all"
AS_BELIEVED = RobotFit((), np.zeros(1), {}, 10.0)
GAINED = RobotFit((GAIN,), np.zeros(2), {}, 5.0)
LOOSE = RobotFit((PLAY,), np.array([0.0, 5.0]), {}, 9.0)
RISEN = RobotFit((GAIN, SAG), np.zeros(3), {}, 5.0)
NAMED_GAIN = RobotGain(GAIN, GAINED, 30.0, 2.0, None)
NAMED_PLAY = RobotGain(PLAY, LOOSE, 30.0, 2.0, None)
NOTHING = RobotFindings(AS_BELIEVED, AS_BELIEVED, (), (), {}, ())


def late(*_, **__):
    raise OutOfTimeError


def shaker(name=PLAY, fit=LOOSE):
    return Shaker(SimpleNamespace(name=name, fit=fit, knob=5.0), SimpleNamespace())


def riser():
    return Riser(SimpleNamespace(name=SAG, fit=RISEN), SimpleNamespace())


def naming(*, tell=lambda _: None, rattling=None, rising=None, **held):
    """Something that names, whose search has no time and whose judges are ``held``."""
    placed = {
        f"{name}@all": SimpleNamespace(effect=effect(name))
        for name in ("dead_zone", "punch", "voltage_sag", "gain_error")
    }
    asked = {"consistent": lambda _: False, "far": lambda _: 0, "volts_denied": lambda _: 0.0}
    search = SimpleNamespace(
        model=SimpleNamespace(placed=placed), sight=SimpleNamespace(held={}), run=late
    )
    return Naming(
        search,
        SimpleNamespace(**asked | {"stands": False} | held),
        SimpleNamespace(**(rattling or {})),
        SimpleNamespace(named=rising or (lambda *_: None)),
        tell,
    )


# --- all that tells, one after the other


def answering(monkeypatch, *, play=None, springs=None, weak=None, denies=False, bears_out=True):
    """What asks its own parts, each of which is a stub, and what it has asked of them."""
    asked = []
    named = Named(replaced(LOOSE if play else AS_BELIEVED), [], AS_BELIEVED, [])
    made = naming(
        rattling={"denies": lambda after: denies, "bears_out": lambda after: bears_out},
        without=lambda base, after, name: AS_BELIEVED,
    )
    made.search.believed = lambda: AS_BELIEVED

    def shaken(base, without, kind=is_play):
        assert base is AS_BELIEVED
        asked.append("play" if kind is is_play else "springs")
        return play if kind is is_play else springs

    def by_means(base, without, again):
        asked.append(("means", base, without, again))
        return named

    def risen(now, without):
        asked.append("rise")
        assert not (play and bears_out)
        return (now._replace(after=RISEN) if weak else now), weak

    monkeypatch.setattr(made, "_shaker", shaken)
    monkeypatch.setattr(made, "_with_play", lambda base, play: LOOSE)
    monkeypatch.setattr(made, "_without_play", lambda named: named._replace(rejected=["play"]))
    monkeypatch.setattr(made, "named", by_means)
    monkeypatch.setattr(made, "_risen", risen)
    return made, asked


def replaced(base):
    return RobotFindings(base, base, (), (), {}, ())


def test_where_nothing_has_a_name_all_is_asked(monkeypatch):
    made, asked = answering(monkeypatch)
    answer = made.answer(frozenset({"tilt"}))
    assert asked == ["play", ("means", AS_BELIEVED, {"tilt"}, True), "rise", "springs"]
    assert (answer.shaker, answer.riser, answer.base) == (None, None, AS_BELIEVED)
    assert answer.whole is AS_BELIEVED


def test_beside_play_that_shakes_nothing_else_is_asked_but_means(monkeypatch):
    made, asked = answering(monkeypatch, play=shaker())
    answer = made.answer(frozenset({"tilt"}))
    assert asked == ["play", ("means", LOOSE, RATTLING | {"tilt"}, False)]
    assert answer.whole.names == (PLAY,)
    assert answer.base is AS_BELIEVED
    assert answer.named.found.base is LOOSE


def test_play_that_is_not_borne_out_is_no_name_and_the_rest_is_asked(monkeypatch):
    made, asked = answering(monkeypatch, play=shaker(), bears_out=False)
    answer = made.answer(frozenset())
    assert asked[2:] == ["rise", "springs"]
    assert answer.shaker is None
    assert answer.named.found.base is AS_BELIEVED


def test_what_a_rise_names_is_told_and_springs_are_not_asked(monkeypatch):
    found = riser()
    made, asked = answering(monkeypatch, weak=found)
    answer = made.answer(frozenset())
    assert asked[2:] == ["rise"]
    assert answer.riser is found
    assert answer.whole is RISEN


def test_springs_come_last(monkeypatch):
    found = shaker(SPRINGS, RobotFit((SPRINGS,), np.array([0.0, 2.0]), {}, 10.0))
    made, _ = answering(monkeypatch, springs=found)
    answer = made.answer(frozenset())
    assert answer.shaker is found
    assert answer.whole.names == (SPRINGS,)


@pytest.mark.parametrize("denies", [True, False])
def test_play_that_joints_shake_too_little_for_is_taken_back(monkeypatch, denies):
    made, _ = answering(monkeypatch, denies=denies)
    assert made.answer(frozenset()).named.rejected == (["play"] if denies else [])


def test_an_answer_is_whole_with_what_shaking_names():
    named = Named(NOTHING, [], AS_BELIEVED, [])
    assert Answer(AS_BELIEVED, named).whole is AS_BELIEVED
    assert Answer(AS_BELIEVED, named, shaker()).whole.settings == LOOSE.settings


# --- by shaking


@pytest.mark.parametrize("kind", [is_play, is_spring])
def test_shaking_is_left_out_where_there_is_no_time(kind):
    found = shaker()
    made = naming(rattling={"named": lambda base, without, asked: (found, asked)})
    assert made._shaker(AS_BELIEVED, frozenset(), kind) == (found, kind)
    made = naming(rattling={"named": late})
    assert made._shaker(AS_BELIEVED, frozenset(), kind) is None


@pytest.mark.parametrize(("cost", "loose"), [(9.0, True), (11.0, False)])
def test_a_search_begins_with_play_where_means_over_the_phase_are_no_worse_for_it(cost, loose):
    made = naming()
    begun = RobotFit(LOOSE.names, LOOSE.z, {}, cost)

    def thoroughly(names, knobs, noise):
        assert made.search.sight.held == {PLAY: 5.0}
        assert (names, knobs.tolist()) == ((PLAY,), [5.0])
        return begun

    made.search.thoroughly = thoroughly
    assert made._with_play(AS_BELIEVED, shaker()) is (begun if loose else AS_BELIEVED)


def test_play_that_is_denied_is_left_out_of_the_fit_and_other_names_stay():
    made = naming(without=lambda base, after, name: (base, name))
    named = Named(NOTHING, [NAMED_GAIN, NAMED_PLAY], LOOSE, [])
    assert made._without_play(named) == (NOTHING, [NAMED_GAIN], (AS_BELIEVED, PLAY), [])


@pytest.mark.parametrize(
    ("taken", "consistent", "asked"), [((), False, True), ((1,), False, False), ((), True, False)]
)
def test_springs_are_asked_of_shaking_where_means_name_nothing(taken, consistent, asked):
    made = naming(
        rattling={"named": lambda base, without, kind: kind}, consistent=lambda _: consistent
    )
    assert (made._springs(AS_BELIEVED, taken, frozenset()) is is_spring) is asked


# --- by how it stands up


@pytest.mark.parametrize(("worse", "kept"), [(NEEDED - 0.1, []), (NEEDED + 0.1, [NAMED_GAIN])])
def test_names_are_kept_that_are_needed_beside_what_a_rise_shows(worse, kept):
    found = riser()
    bare = RobotFit((SAG,), np.zeros(2), {}, RISEN.cost + NAMED_GAIN.inflation * worse)
    made = naming(
        rising=lambda *_: found, without=lambda *_: bare, consistent=lambda now: now is bare
    )
    named, told = made._risen(Named(NOTHING, [NAMED_GAIN], GAINED, []), frozenset())
    assert told is found
    assert named == (NOTHING, kept, RISEN if kept else bare, [])


@pytest.mark.parametrize("rising", [lambda *_: None, late])
def test_where_a_rise_shows_nothing_or_there_is_no_time_all_is_as_it_was(rising):
    before = Named(NOTHING, [NAMED_GAIN], GAINED, ["one"])
    assert naming(rising=rising)._risen(before, frozenset()) == (before, None)


def test_where_more_is_left_of_the_gait_there_is_another_search_with_it(monkeypatch):
    found, asked = riser(), []
    made = naming(rising=lambda *_: found)
    before = Named(NOTHING, [], GAINED, ["one"])

    def searched(base, without, again):
        asked.append((base, without, again))
        return Named("found", ["tips"], "fit", ["two"])

    monkeypatch.setattr(made, "searched", searched)
    named, _ = made._risen(before, frozenset({"payload"}))
    assert asked == [(RISEN, {"payload", "voltage_sag"}, False)]
    assert named == ("found", ["tips"], "fit", ["one", "two"])
    monkeypatch.setattr(made, "searched", late)
    named, told = made._risen(before, frozenset())
    assert (named, told) == ((NOTHING, [], RISEN, ["one"]), found)


@pytest.mark.parametrize(
    ("shown", "without", "says", "times"),
    [(True, (), True, 1), (False, (), False, 1), (True, RATTLING, False, 0)],
    ids=["shown", "not shown", "rattles"],
)
def test_what_stands_up_worse_with_a_name_is_asked_how_it_does_and_once(
    shown, without, says, times
):
    asked, told = [], []

    def rising(after, left_out):
        asked.append((after, left_out))
        return riser() if shown else None

    def kept(found, say, risen):
        told.extend([risen(GAINED), risen(GAINED)])
        return Named(found, [], GAINED, [])

    made = naming(rising=rising, kept=kept)
    made.search.run = lambda **_: NOTHING
    made.searched(AS_BELIEVED, frozenset(without), again=False)
    assert told == [says, says]
    assert asked == [(GAINED, frozenset(without))] * times


# --- by means over the phase


@pytest.mark.parametrize(
    ("cut", "again", "because"),
    [
        (False, True, NO_BETTER),
        (True, True, NO_BETTER),
        (False, False, NO_BETTER),
        (False, True, NO_SIZE),
        (False, True, UNSURE),
        (False, True, STANDS_IN),
        (False, True, DRIVEN),
        (False, True, OTHER_VOLTS),
        (False, True, ASSUMED),
        (False, True, AS_WELL),
    ],
    ids=[
        "in time",
        "cut",
        "beside play",
        "no size",
        "one of several",
        "stands in",
        "driven",
        "volts",
        "assumed",
        "as well",
    ],
)
def test_what_was_found_is_told_whatever_the_time(cut, again, because):
    """Only another search is left out: the first one's name was taken back."""
    told, searches = [], []

    def run(without, base, done, far, volts):
        assert (done, far) == (made.held.consistent, made.held.far)
        assert volts is made.held.volts_denied
        if cut and searches:
            late()
        searches.append(without)
        name = "punch" if "dead_zone" in without else "dead_zone"
        return SimpleNamespace(taken=(SimpleNamespace(name=f"{name}@all"),))

    def kept(found, say, risen):
        say("asking")
        (gain,) = found.taken
        taken = [gain] if gain.name == "punch@all" else []
        return Named(found, taken, found, [] if taken else [row])

    row = {"effect": "dead_zone@all", "because": because}
    made = naming(tell=told.append, kept=kept)
    made.search.run = run
    twice = again and not cut and because in (NO_BETTER, NO_SIZE)
    found, taken, _, rejected = made.searched(AS_BELIEVED, frozenset(), again)
    assert [gain.name for gain in taken] == (["punch@all"] if twice else [])
    assert found.taken[0].name == ("punch@all" if twice else "dead_zone@all")
    assert rejected == [row]
    assert told == ["asking"] * (2 if twice else 1)


@pytest.mark.parametrize(
    ("consistent", "stands", "cut", "holds", "after"),
    [
        (False, False, False, True, "named"),
        (False, False, False, False, "deeper"),
        (False, True, False, True, "named"),
        (True, False, False, True, "named"),
        (True, False, False, False, "believed"),
        (True, False, True, True, "believed"),
        (True, True, False, True, "believed"),
    ],
)
def test_what_is_consistent_is_searched_once_where_it_walks_and_stays_so_without_a_name(
    monkeypatch, consistent, stands, cut, holds, after
):
    """Wherever else fits without a name have led."""
    asked = []

    def searched(base, without, again):
        asked.append(again)
        if cut:
            late()
        taken = ["tilt"] if holds else []
        found = RobotFindings("deeper", "named", tuple(taken), (), {}, ())
        return Named(found, taken, "named" if holds else "deeper", ["a name"])

    made = naming(consistent=lambda _: consistent, stands=stands)
    made.search.nothing = lambda base: RobotFindings(base, base, (), (), {}, ())
    monkeypatch.setattr(made, "searched", searched)
    found, taken, fit, rejected = made.named("believed", frozenset(), True)
    assert asked == ([] if consistent and stands else [not consistent])
    assert (fit, bool(taken)) == (after, after == "named")
    assert (found.base, found.fit) == (
        ("believed", "believed") if fit == "believed" else ("deeper", "named")
    )
    assert rejected == ([] if not asked or cut else ["a name"])


@pytest.mark.parametrize("stands", [True, False])
def test_no_zero_of_a_joint_is_named_where_a_robot_stands(stands):
    """There chance drags zeros as far as they may go."""
    asked = []

    def found(without):
        asked.append(without)
        return NOTHING

    made = naming(
        consistent=lambda _: False,
        kept=lambda found, say, risen: Named(found, [], "fit", []),
        stands=stands,
    )
    made.search.run = lambda without, base, done, far, volts: found(without)
    made.named(AS_BELIEVED, frozenset({"punch"}), True)
    assert asked == [{"punch", *(["zero_offset"] if stands else [])}]
