"""Running trials: same seed, same recording; what is finished is kept; a run goes on."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from experiment_runs import campaign, quiet

from bench.experiments import EXPERIMENTS
from bench.experiments.campaign import Campaign, recordings_in
from bench.experiments.experiment import Choice, ExperimentError
from bench.experiments.report import document, summary, write_report
from bench.recording import read, write
from busemu.tables.robots import parse_robot


def leg_steps(folder, repeats=2, seed=0):
    return campaign("leg-step", "marvin", folder, Choice(repeats=repeats, seed=seed))


def columns(recording):
    """Numbers as bytes, since NaN differs from itself."""
    table = recording.table
    numbers = [table[name].to_numpy().tobytes() for name in ("t_s", "t_reply_s", "raw")]
    return *numbers, table["register"].to_pylist(), table["servo_id"].to_pylist()


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished campaign, its recordings and its report."""
    done = leg_steps(tmp_path_factory.mktemp("finished"))
    recordings = done.run(quiet)
    result = done.experiment.evaluate(recordings)
    write_report(done.experiment, result, recordings, done.folder)
    return done, recordings, result


def test_each_experiment_says_what_it_is_and_what_to_prepare(finished):
    robot = finished[0].robot
    assert list(EXPERIMENTS) == ["servo-check", "torque-analysis", "leg-step", "locomotion"]
    for name, experiment in EXPERIMENTS.items():
        assert experiment.name == name
        trials = experiment.trials(robot, Choice(repeats=5))
        assert len({trial.name for trial in trials}) == len(trials) in (5, 15)
        words = {experiment.preparation(robot, trial) for trial in trials}
        assert len(words) == (3 if name == "torque-analysis" else 1)  # a load, a preparation


def test_the_same_seed_gives_the_same_recording_to_the_bit(finished, tmp_path):
    again = leg_steps(tmp_path, repeats=1).run(quiet)
    assert columns(again[0]) == columns(finished[1][0])
    other = leg_steps(tmp_path / "other", repeats=1, seed=7).run(quiet)
    assert columns(other[0]) != columns(again[0])


def test_a_recording_says_how_it_was_made(finished):
    done, recordings, _ = finished
    facts = recordings[0].metadata
    assert facts["group"] == "leg-step"
    assert facts["source"] == "emulator"
    assert facts["condition"]["support"] == "suspended"
    assert facts["condition"]["supply_v"] == 7.4
    assert [r.metadata["condition"]["repeat"] for r in recordings] == [1, 2]
    assert done.path(done.trials[0]) == recordings[0].path


def test_evaluating_the_recordings_gives_the_result_of_the_run(finished):
    done, recordings, result = finished
    found = recordings_in(done.folder, "leg-step")
    assert [r.name for r in found] == [r.name for r in recordings]
    again = done.experiment.evaluate(found)
    told = document(done.experiment, again, found)
    assert told == document(done.experiment, result, recordings)
    assert json.loads((done.folder / "result.json").read_text("utf-8")) == told


def test_what_cannot_be_compared_is_called_so(finished):
    done, recordings, result = finished
    told = document(done.experiment, result, recordings)
    rmse = next(row for row in told["beside_the_thesis"] if row["what"] == "RMSE of position")
    assert rmse["comparable"] is False
    assert "not published" in rmse["why_not"]
    assert "not published" in summary(result, recordings)


def test_a_report_leaves_two_files_and_nothing_else(finished):
    done, _, _ = finished
    names = {path.name for path in done.folder.iterdir()}
    assert names == {"recordings", "figure.png", "result.json"}
    assert (done.folder / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_a_broken_off_run_keeps_what_is_finished_and_goes_on(finished, tmp_path):
    broken = leg_steps(tmp_path)

    def stop_in_the_second(trial):
        def progress(run_s):
            if trial.repeat == 2 and run_s > 1.5:
                raise KeyboardInterrupt

        return progress

    with pytest.raises(KeyboardInterrupt):
        broken.run(stop_in_the_second)
    folder = tmp_path / "recordings"
    assert [path.name for path in folder.iterdir()] == ["leg-step-01.parquet"]
    kept_ns = broken.path(broken.trials[0]).stat().st_mtime_ns
    ran = []
    recordings = broken.run(lambda trial: ran.append(trial.name) or quiet(trial))
    assert ran == ["leg-step-02"]
    assert broken.path(broken.trials[0]).stat().st_mtime_ns == kept_ns
    assert [columns(r) for r in recordings] == [columns(r) for r in finished[1]]


@pytest.mark.parametrize("name", list(EXPERIMENTS))
def test_ctrl_c_lets_go_of_the_robot(name, tmp_path, monkeypatch):
    every = campaign(name, "marvin", tmp_path)
    one = replace(every, trials=every.trials[:1])
    seen = []
    session = Campaign._session

    def watched(self, trial):
        seen.append(session(self, trial))
        return seen[-1]

    monkeypatch.setattr(Campaign, "_session", watched)
    sessions = []
    run = type(every.experiment).run

    def remembering(self, session, trial, progress):
        sessions.append(session)
        return run(self, session, trial, progress)

    monkeypatch.setattr(type(every.experiment), "run", remembering)

    def interrupt(run_s):
        if run_s > 2.5:
            assert any(servo.memory["torque_enable"] for servo in sessions[0].bus.servos)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        one.run(lambda _: interrupt)
    assert not any(servo.memory["torque_enable"] for servo in sessions[0].bus.servos)
    assert not list((tmp_path / "recordings").iterdir())


def test_a_folder_of_another_run_is_refused(finished):
    done, _, _ = finished
    with pytest.raises(
        ExperimentError, match=r"leg-step-01.parquet is of another run, with another seed: choose"
    ):
        leg_steps(done.folder, seed=3).run(quiet)
    other = campaign("leg-step", "marvin", done.folder, Choice(repeats=1, leg="leg1"))
    with pytest.raises(ExperimentError, match=r"with another leg: choose another --out"):
        other.run(quiet)


def test_a_folder_of_another_model_of_the_same_robot_is_refused_and_not_reused(finished):
    done, _, _ = finished
    sag = {"name": "voltage_sag", "parameters": {"resistance_ohm": {"value": 0.5, "source": "a"}}}
    document = {**done.robot.document, "effect": [sag]}
    changed = replace(done, robot=parse_robot(document, done.robot.path))
    with pytest.raises(ExperimentError, match=r"with another model: choose another --out"):
        changed.run(quiet)


def test_a_folder_without_recordings_of_the_experiment_is_refused(finished, tmp_path):
    done, recordings, _ = finished
    with pytest.raises(ExperimentError, match="no recording there"):
        recordings_in(tmp_path, "leg-step")
    with pytest.raises(ExperimentError, match=r"'locomotion' \(there are leg-step\)"):
        recordings_in(done.folder, "locomotion")
    write(recordings[0], tmp_path / "mine.csv")
    assert [r.name for r in recordings_in(tmp_path, "leg-step")] == ["leg-step-01"]
    assert columns(read(tmp_path / "mine.csv")) == columns(recordings[0])


def test_a_person_is_asked_before_anything_moves(tmp_path):
    asked = []

    def refuse(words):
        asked.append(words)
        return False

    real = replace(leg_steps(tmp_path), port="/dev/nowhere")
    with pytest.raises(ExperimentError, match="nothing is switched on"):
        real.run(quiet, refuse)
    assert len(asked) == 1
    assert "stand" in asked[0]


def test_nobody_is_asked_only_where_one_preparation_does(tmp_path):
    for port in ("/dev/nowhere", "/dev/pts/0"):
        loaded = replace(campaign("torque-analysis", "marvin", tmp_path), port=port)
        assert len({loaded.preparation(trial) for trial in loaded.trials}) == 3
        with pytest.raises(ExperimentError, match="prepared 3 times in between"):
            loaded.run(quiet)


def test_a_recording_claims_no_stand_and_no_voltage_that_nobody_saw(tmp_path):
    held = replace(leg_steps(tmp_path), port="/dev/pts/0")
    assert held.facts(held.trials[0])["support"] == "ground"
    real = replace(leg_steps(tmp_path), port="/dev/ttyUSB0")
    assert real.facts(real.trials[0])["support"] == "suspended"
    assert "supply_v" not in real.facts(real.trials[0])


def test_a_report_that_cannot_be_drawn_changes_nothing(finished, monkeypatch):
    done, recordings, result = finished
    before = {path: path.read_bytes() for path in done.folder.iterdir() if path.is_file()}

    def fail(self, result):
        raise OSError(28, "No space left on device", "figure.png")

    monkeypatch.setattr(type(done.experiment), "draw", fail)
    with pytest.raises(OSError, match="No space left"):
        write_report(done.experiment, result, recordings[:1], done.folder)
    assert {path: path.read_bytes() for path in done.folder.iterdir() if path.is_file()} == before
