"""Play that shaking names: in what the search on means begins with, or beside what it found."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.joint.floor import tolerance
from bench.diagnosis.noise import Block, Noise
from bench.diagnosis.report.telling import channel_finding
from bench.diagnosis.result import FitSummary
from bench.diagnosis.robot.channels import noise_of
from bench.diagnosis.robot.fit import RobotFit
from bench.diagnosis.robot.judges import PART, SAMPLES
from bench.diagnosis.robot.limits import far_samples
from bench.diagnosis.robot.rattling import Shaker, still_far, worsened

BASE = RobotFit((), np.zeros(1), {}, 10.0)
LOOSE = RobotFit(("backlash@all",), np.array([0.0, 5.0]), {}, 10.0)
PLAY = Shaker(SimpleNamespace(name="backlash@all", fit=LOOSE), SimpleNamespace())


def test_play_is_beside_what_was_found_once():
    assert PLAY.beside(BASE).settings == LOOSE.settings
    assert PLAY.beside(LOOSE) is LOOSE


@pytest.mark.parametrize(
    ("scatter_rad", "lasts_rad", "quiet"),
    [(0.1e-3, 0.0, True), (3e-3, 0.0, False), (0.1e-3, 3e-3, False)],
)
def test_of_rows_that_scatter_by_themselves_nobody_says_that_rounding_alone_is_left(
    scatter_rad, lasts_rad, quiet
):
    sways = np.full((9, 1), lasts_rad)
    rows = Block(np.arange(9.0), np.zeros(9), np.full(9, scatter_rad**2), sways)
    channel = {
        "channel": "position",
        "rms_before": 3.9e-3,
        "rms_after": 3.5e-3,
        "rounding": 1.06e-3,
        "noise": noise_of([rows, rows], Noise(0.87e-3, 0.0, 1.0)),
    }
    told = channel_finding(channel, SimpleNamespace(unexplained=(), causes=()))
    assert ("nothing is left but rounding" in told) is quiet


@pytest.mark.parametrize(
    ("effects", "more", "speaks"),
    [
        (["backlash"], 1.2, False),
        (["backlash", "gain_error"], 1.2, True),
        (["gain_error"], 1.2, True),
        (["gain_error"], 0.9, False),
        ([], 1.2, False),
    ],
)
def test_samples_that_are_farther_off_do_not_speak_against_play_alone(effects, more, speaks):
    floor = 1e-3
    before = 3.0 * tolerance(floor)
    causes = [SimpleNamespace(effect=effect) for effect in effects]
    assert worsened(causes, FitSummary(before, more * before, floor, True, ("walk",))) is speaks


@pytest.mark.parametrize(
    ("effects", "took", "speaks"),
    [
        (("gain_error",), 0.9 * PART, True),
        (("gain_error",), 1.1 * PART, False),
        (("gain_error", "backlash"), 0.9 * PART, False),
        ((), 0.0, True),
    ],
)
def test_samples_of_which_names_leave_most_say_that_more_is_the_matter(effects, took, speaks):
    floor, before = 1.0, 3.0 * SAMPLES
    causes = [SimpleNamespace(effect=effect) for effect in effects]
    after = (before**2 - took * (before**2 - floor**2)) ** 0.5
    fit = FitSummary(before, after, floor, True, ("walk",))
    assert still_far(causes, fit, bare=not effects) is speaks
    assert not still_far(causes, fit, PLAY, bare=False)


@pytest.mark.parametrize("effects", [(), ("gain_error",)])
def test_samples_that_are_near_say_nothing(effects):
    causes = [SimpleNamespace(effect=effect) for effect in effects]
    near = FitSummary(0.95 * SAMPLES, 0.95 * SAMPLES, 1.0, True, ("walk",))
    assert not still_far(causes, near, bare=not effects)


def test_it_is_told_how_far_samples_are_off_with_all_that_is_named():
    (line,) = far_samples(FitSummary(9e-3, 6.24e-3, 1.8e-3, True, ("walk",)))
    assert "6.2 mrad" in line
    assert "1.8 mrad" in line
