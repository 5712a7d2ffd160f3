"""What tolerances leave of effects in robots, written into a proof's table."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from bench.blind.case import Asked
from bench.blind.legged_case import draw_legged, nuisance_document
from bench.proof import robots_left
from bench.proof.robots_left import FOLDER, app, drawn, fill, wanted
from bench.proof.table import write_table
from tests.bench.proof.judged_cases import hidden_in, judged, key, robot_diagnosis, robot_key

ASKED = Asked("null", rig="marvin-walk", disguise=False)


def null_key(**more):
    case = draw_legged(7, ASKED)
    told = json.loads(json.dumps(nuisance_document(case.nuisances)))
    asked = json.loads(json.dumps(ASKED.document()))
    one = {"case": "robot-1", "seed": 7, "asked": asked, "effects": [], "nuisances": told}
    return one | more


def proof(folder: Path) -> Path:
    weight = hidden_in("payload", ["leg1.femur"], mass_kg=(0.5, 0.0))
    keys = {
        "robot-1": robot_key("single", weight),
        "robot-2": robot_key("pair", weight, weight),
        "robot-3": robot_key("null"),
        "case-1": key("single", weight),
    }
    (folder / "keys").mkdir()
    for name, one in keys.items():
        (folder / "keys" / f"{name}.json").write_text(json.dumps(one), encoding="utf-8")
    names = ["robot-1", "robot-2", "robot-3"]
    every = [judged(keys[name], robot_diagnosis(), name) for name in names]
    write_table(every, folder / "cases.csv")
    return folder


def keep(folder: Path, left: dict[str, list[dict[str, float]]]) -> None:
    (folder / FOLDER).mkdir()
    for name, effects in left.items():
        (folder / FOLDER / f"{name}.json").write_text(json.dumps(effects), encoding="utf-8")


def column(folder: Path) -> list[str]:
    with (folder / "cases.csv").open(encoding="utf-8") as file:
        return [line["ratio_left"] for line in csv.DictReader(file)]


def test_robots_in_which_something_is_hidden_are_measured(tmp_path: Path) -> None:
    assert list(wanted(proof(tmp_path))) == ["robot-1", "robot-2"]


def test_the_least_of_several_stands_in_the_table(tmp_path: Path) -> None:
    folder = proof(tmp_path)
    before = (folder / "cases.csv").read_text("utf-8")
    fill(folder, {})
    assert (folder / "cases.csv").read_text("utf-8") == before
    fill(folder, {"robot-1": [{"ratio": 0.51234}], "robot-2": [{"ratio": 2.0}, {"ratio": 1.0}]})
    assert column(folder) == ["0.512", "1", ""]


def test_what_is_measured_is_kept_and_told(tmp_path: Path) -> None:
    folder = proof(tmp_path)
    left = {"robot-1": [{"ratio": 0.5}], "robot-2": [{"ratio": 2.0}, {"ratio": 1.0}]}
    keep(folder, left)
    told = CliRunner().invoke(app, [str(folder)])
    assert told.exit_code == 0
    assert "robot-1  payload 0.5 of 5 floors\n" in told.output
    assert column(folder) == ["0.5", "1", ""]


def test_a_seed_draws_its_robot_or_the_error_says_so() -> None:
    assert drawn(null_key()).nuisances == draw_legged(7, ASKED).nuisances
    with pytest.raises(ValueError, match="robot-1: its seed draws another robot now"):
        drawn(null_key(seed=8))
    other = null_key(effects=[{"effect": "payload", "size": 0.5}])
    with pytest.raises(ValueError, match="another robot"):
        drawn(other)


def test_a_folder_that_was_not_opened_is_refused(tmp_path: Path) -> None:
    told = CliRunner().invoke(app, [str(tmp_path)])
    assert told.exit_code == 1
    assert told.output.startswith(f"error: {tmp_path}: no keys of robots")
    proof(tmp_path)
    (tmp_path / "cases.csv").unlink()
    assert CliRunner().invoke(app, [str(tmp_path)]).exit_code == 1
    assert not (tmp_path / FOLDER).exists()


def test_a_robot_that_cannot_be_measured_is_told_and_the_others_count(tmp_path: Path) -> None:
    folder = proof(tmp_path)
    other = null_key(seed=8, rig="marvin-walk", effects=[{"effect": "payload", "size": 0.5}])
    (folder / "keys" / "robot-2.json").write_text(json.dumps(other), encoding="utf-8")
    keep(folder, {"robot-1": [{"ratio": 0.5}]})
    told = CliRunner().invoke(app, [str(folder)])
    assert told.exit_code == 1
    assert "robot-1  payload 0.5 of 5 floors\n" in told.stdout
    assert "robot-2: error: robot-1: its seed draws another robot now" in told.stderr
    assert column(folder) == ["0.5", "", ""]
    assert not (folder / FOLDER / "robot-2.json").exists()


def test_what_is_left_where_more_is_granted_is_apart_and_in_no_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = proof(tmp_path)
    left = {"robot-1": [{"ratio": 0.5}], "robot-2": [{"ratio": 2.0}, {"ratio": 1.0}]}
    keep(folder, left)
    more = ["--supply", "0.04", "--gain", "0.06"]
    told = []

    def run(jobs, processes):
        told.extend(jobs)
        for job in told:
            job.log.write_text("", encoding="utf-8")
            effects = [{"ratio": 0.1}, {"ratio": 0.2}][: 1 + (job.name == "robot-2")]
            job.log.with_suffix(".json").write_text(json.dumps(effects), encoding="utf-8")
            yield SimpleNamespace(job=job, code=0)

    monkeypatch.setattr(robots_left, "run", run)
    said = CliRunner().invoke(app, [str(folder), *more])
    assert said.exit_code == 0
    assert "robot-1  payload 0.1 of 5 floors\n" in said.output
    assert column(folder) == ["", "", ""]
    assert [job.command[-4:] for job in told] == [tuple(more)] * 2
    assert (folder / "left-supply-0.04-gain-0.06" / "robot-1.json").exists()
    assert CliRunner().invoke(app, [str(folder)]).exit_code == 0
    assert column(folder) == ["0.5", "1", ""]


def test_one_robot_is_measured_with_what_is_granted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = proof(tmp_path)
    case = SimpleNamespace(hidden=("a weight",))
    monkeypatch.setattr(robots_left, "drawn", lambda key: case)

    def left(case, index, granted):
        return SimpleNamespace(ratio=granted.gain, imitation={"supply": granted.supply})

    monkeypatch.setattr(robots_left, "legged_left", left)
    told = ["--one", "robot-1", "--gain", "0.06", "--supply", "0.04"]
    assert CliRunner().invoke(app, [str(folder), *told]).exit_code == 0
    (kept,) = json.loads((folder / "left-supply-0.04-gain-0.06" / "robot-1.json").read_text())
    assert kept == {"ratio": 0.06, "imitation": {"supply": 0.04}}


def test_a_robot_without_an_effect_is_refused_by_its_name(tmp_path: Path) -> None:
    told = CliRunner().invoke(app, [str(proof(tmp_path)), "--one", "robot-3"])
    assert told.exit_code == 1
    asked = "--one robot-3: nothing is hidden in it; there are robot-1, robot-2"
    assert told.output == f"error: {asked}\n"
    assert not (tmp_path / FOLDER).exists()


def test_no_less_of_a_supply_is_granted_than_is_drawn(tmp_path: Path) -> None:
    folder = proof(tmp_path)
    assert CliRunner().invoke(app, [str(folder), "--supply", "0.01"]).exit_code == 2
    assert not list(folder.glob("left*"))
