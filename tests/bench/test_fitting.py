"""Three ways of fitting one model to the same logs: each where the answer is known."""

import os
import sys
from math import inf
from pathlib import Path

import numpy as np
import pytest

from bench.fitting import __main__ as command
from bench.fitting import problem as problems
from bench.fitting.methods import EVOLUTION, OURS, run, ways
from bench.fitting.problem import MODELS, NUMBERS, mae_rmse, recorded, simulated
from bench.fitting.replays import KernelReplay, LoopReplay
from bench.recording import RecordingError

SHORT_S = 2.0
ROUNDING_RAD = 2.0 * np.pi / 4096 / np.sqrt(12.0)  #: deviation of a register's rounding
MUJOCO = "MuJoCo's, "


def short(model):
    return simulated(model, seed=1, duration_s=SHORT_S)


def engine():
    return pytest.importorskip("bench.fitting.engine", reason="needs MuJoCo")


def rms(replay, model, problem, z):
    return mae_rmse(replay(model, problem.hypothesis)([z])[0])[1]


@pytest.mark.parametrize("model", MODELS)
def test_our_simulator_leaves_the_rounding_at_the_truth(model):
    problem = short(model)
    low, high = problem.box
    assert (low <= problem.truth).all()
    assert (problem.truth <= high).all()
    for logs in (problem.fitted, problem.judge):
        assert rms(KernelReplay, logs, problem, problem.truth) < 1.25 * ROUNDING_RAD


@pytest.mark.parametrize("model", MODELS)
def test_mujoco_moves_as_our_simulator_does(model):
    problem, replay = short(model), engine().MujocoReplay
    for logs in (problem.fitted, problem.judge):
        assert rms(replay, logs, problem, problem.truth) < 1e-3
        assert rms(replay, logs, problem, problem.start) > 5e-3


@pytest.mark.parametrize("model", MODELS)
def test_the_loop_of_5_ms_moves_nearly_so(model):
    problem = short(model)
    for logs in (problem.fitted, problem.judge):
        at_truth = rms(LoopReplay, logs, problem, problem.truth)
        assert at_truth < 0.015
        assert at_truth < 0.5 * rms(LoopReplay, logs, problem, problem.start)


@pytest.mark.parametrize(
    "name",
    [OURS, "ours, as a diagnosis", EVOLUTION, MUJOCO + "default step", MUJOCO + "step 0.0001"],
)
def test_each_way_finds_the_torque_constant_and_the_dry_friction(name):
    if name.startswith(MUJOCO):
        engine()
    problem = short("M1")
    found = run(ways()[name], problem, inf, lambda error: None)
    values = {
        knob.effect: (knob.value(x), knob.value(true))
        for knob, x, true in zip(problem.hypothesis.knobs, found.z, problem.truth, strict=True)
    }
    assert not found.cut
    assert found.fitted[1] < 1e-3
    for effect, size in (("torque_constant", 0.02), ("coulomb_friction", 1e-3)):
        got, true = values[effect]
        assert got == pytest.approx(true, abs=size), effect


def test_a_way_that_is_cut_off_gives_the_best_it_had():
    problem = short("M1")
    found = run(ways()[EVOLUTION], problem, 1e-9, lambda error: None)
    assert found.cut
    assert found.ledger.candidates == 1
    assert found.fitted[0] == found.ledger.line[-1].error == found.near.error


def test_a_ledger_keeps_what_got_better():
    ledger = problems.Ledger(inf, absolute=True)
    for k, error in enumerate((0.3, 0.5, 0.1)):
        ledger.note([np.array([float(k)])], [np.array([error, -error])])
    assert [one.error for one in ledger.line] == [0.3, 0.1]
    assert ledger.best.tolist() == [2.0]
    assert ledger.candidates == 3
    assert ledger.reached(0.2) is ledger.line[1]


def test_numbers_are_within_the_catalogue():
    for model in MODELS:
        for knob in problems.hypothesis_of(model).knobs:
            low, high, *truth = NUMBERS[knob.effect]
            known = problems.effect(knob.effect).parameters[0]
            assert known.low <= low < truth[0] < truth[1] < high <= known.high


def test_public_logs_are_split_by_their_gain(tmp_path):
    place = os.environ.get("BUSEMU_RECORDINGS")
    if not place or not (folder := Path(place, "bam-xl330")).exists():
        pytest.skip("BUSEMU_RECORDINGS does not say where bam-xl330 is")
    problem = recorded("M3", folder)
    for logs, gain in ((problem.fitted, 400), (problem.judge, 100)):
        assert [one.registers["position_p_gain"] for one in logs.observed] == [gain] * 3
    raw = next(folder.rglob("*10h28m10.json"))
    (tmp_path / raw.name).write_bytes(raw.read_bytes())
    with pytest.raises(RecordingError, match="two gains"):
        recorded("M3", tmp_path)


def test_the_command_prints_a_table_and_draws(monkeypatch, capsys, tmp_path):
    picture = tmp_path / "errors.png"
    monkeypatch.delenv("BUSEMU_RECORDINGS", raising=False)
    monkeypatch.setattr(
        sys, "argv", ["fitting", "--quick", "--limit-s", "0.2", "--out", str(picture)]
    )
    command.main()
    said = capsys.readouterr().out
    for name in ways():
        assert said.count(name) == 2, name
    assert "no real logs" in said
    assert "Extrapolated" in said
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--seed", "-1"], "--seed must be 0 to 4294967295, not -1"),
        (["--limit-s", "0"], "--limit-s must be above 0 s, not 0"),
        (["--limit-s", "nan"], "--limit-s must be above 0 s, not nan"),
        (["--out", "errors.txt"], "--out errors.txt: a file .png, .svg, .pdf"),
    ],
)
def test_options_out_of_bounds_are_refused_before_anything_runs(monkeypatch, capsys, words, says):
    monkeypatch.setattr(sys, "argv", ["fitting", *words])
    with pytest.raises(SystemExit):
        command.main()
    assert says in capsys.readouterr().err
