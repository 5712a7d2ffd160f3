"""Case folders: sealed, repeatable, and nothing but beliefs in the open."""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from short_programmes import short

import bench.blind.case
import bench.blind.cases
import bench.blind.drafts
from bench.blind import (
    Asked,
    SealError,
    draw,
    open_key,
    open_truth,
    read_public,
    rerun,
    write_case,
)
from bench.blind.case import STRUCK, THERE, expected_failures
from bench.blind.changes import Setting
from bench.blind.conceal import disguise
from bench.blind.effects import EFFECTS, POSITION
from bench.blind.imitation import Left
from bench.blind.mimic import ALIKE, nearest_rival
from bench.blind.rigs import BRIEF, RIGS
from bench.blind.sizing import Key, noise_floor, observe, rms, size_for
from bench.blind.specimen import Build
from bench.blind.unlisted import STRANGERS
from bench.motions import ExperimentPlan, motion
from bench.recording import read
from busemu.tables import load_robot

SECRET = "a secret that is long enough"
WISH = Asked(
    kind="single",
    effects=("dead_zone",),
    ratio=8.0,
    concealment="plain",
    rig="xl330-turntable",
    programme="short fast",
    disguise=False,
)
NULL = Asked(kind="null", rig="xl330-turntable", programme="short fast", style="fast")


@pytest.fixture(scope="module", autouse=True)
def short_programme() -> Iterator[None]:
    with short("fast"):
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_case(tmp_path_factory.mktemp("cases") / "one", 7, SECRET, WISH)


@pytest.fixture(scope="module")
def null(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_case(tmp_path_factory.mktemp("nulls") / "null", 3, SECRET, NULL)


@pytest.fixture
def nothing_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left of an effect takes long to find, and has tests of its own."""
    monkeypatch.setattr(bench.blind.drafts, "left_of", lambda *_: Left(0.0, {}))


@pytest.fixture(scope="module")
def key(folder: Path) -> dict[str, Any]:
    return open_key(folder, SECRET)


def test_same_seed_gives_the_same_bytes(folder: Path, null: Path, tmp_path: Path) -> None:
    again = write_case(tmp_path / folder.name, 7, SECRET, WISH)
    files = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    assert len(files) == 4 + 10
    for file in files:
        if file.suffix != ".sealed":  # a seal has its own time and salt
            assert (again / file).read_bytes() == (folder / file).read_bytes(), file
    other = write_case(tmp_path / null.name, 4, SECRET, NULL)
    assert read_public(other)["key_sha256"] != read_public(null)["key_sha256"]


def test_key_does_not_open_without_the_secret(folder: Path) -> None:
    with pytest.raises(SealError, match="the seal does not open"):
        open_key(folder, SECRET + "!")
    with pytest.raises(SealError, match="the seal does not open"):
        open_truth(folder, SECRET[:-1])
    assert b"dead_zone" not in (folder / "key.sealed").read_bytes()


def test_short_secret_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SealError, match="shorter than 16"):
        write_case(tmp_path / "weak", 1, "1234", WISH)
    assert list(tmp_path.iterdir()) == []


def test_key_that_was_changed_after_publication_is_refused(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / folder.name
    shutil.copytree(folder, copy)
    public = json.loads((copy / "case.json").read_text())
    public["key_sha256"] = "0" * 64
    (copy / "case.json").write_text(json.dumps(public))
    with pytest.raises(SealError, match="not what was published as key_sha256"):
        open_key(copy, SECRET)


def numbers(document: object) -> set[float]:
    """All numbers in a document but those that everything has."""
    if isinstance(document, dict):
        return set().union(*(numbers(v) for v in document.values()), set())
    if isinstance(document, list):
        return set().union(*(numbers(v) for v in document), set())
    if isinstance(document, int | float) and not isinstance(document, bool):
        return {float(document)}
    return set()


def test_open_files_hold_no_truth(folder: Path, key: dict[str, Any]) -> None:
    robot = (folder / "robot.toml").read_text()
    documents = [dict(load_robot(folder / "robot.toml").document)]
    documents += [read(path).metadata for path in sorted((folder / "recordings").iterdir())]
    believed = set().union(*(numbers(document) for document in documents))
    told = [p["value"] for e in key["effects"] for p in e["parameters"].values()]
    told += [v for v in key["nuisances"].values() if isinstance(v, float) and v not in (0.0, 1.0)]
    assert told
    assert not {float(v) for v in told} & believed
    words = robot + json.dumps(documents[1:]) + (folder / "case.json").read_text()
    for name in (*EFFECTS, *STRANGERS):
        assert f'"{name}"' not in words
    assert "seed" not in words


def test_robot_file_of_a_case_is_that_of_a_null(folder: Path, null: Path) -> None:
    assert (null / "robot.toml").read_bytes() == (folder / "robot.toml").read_bytes()
    assert open_key(null, SECRET)["effects"] == []


def test_recordings_are_simulations_with_groups_and_repeats(folder: Path) -> None:
    recordings = [read(path) for path in sorted((folder / "recordings").iterdir())]
    groups = [r.metadata["group"] for r in recordings]
    assert {groups.count(group) for group in groups} == {2}
    assert {r.metadata["source"] for r in recordings} == {"simulation"}
    assert set(read_public(folder)["held_out"]) < set(groups)
    for recording in recordings:
        assert recording.robot is not None
        assert recording.models[1].model == "XL330-M288"


def test_truth_lies_within_noise_of_what_was_read(folder: Path, key: dict[str, Any]) -> None:
    truth = open_truth(folder, SECRET)
    names = np.array(truth.column("recording").to_pylist())
    for name, oracle in key["oracle"].items():
        recording = read(folder / "recordings" / f"{name}.parquet")
        mine = names == name
        rows = truth.column("row").to_numpy()[mine]
        true = truth.column("position_rad").to_numpy()[mine]
        assert np.array_equal(rows, recording.rows(1, "present_position", "read"))
        raw = recording.table.column("raw").to_numpy()[rows]
        there = ~np.isnan(raw)
        register = recording.register(1, "present_position")
        read_rad = np.array([register.to_si(int(r)) for r in raw[there]])
        apart = read_rad - true[there]
        assert np.abs(apart).max() < 2.0 * register.si_scale
        assert float(np.mean(apart**2)) == pytest.approx(oracle["mse_rad2"])
        times = truth.column("t_true_s").to_numpy()[mine]
        tick_s = key["nuisances"]["tick_s"]
        assert np.all(times > recording.t_s[rows] - tick_s)  # measured at the last tick
        assert np.all(times < recording.t_s[rows] + 0.4e-3)
        ticks = np.diff(times) / tick_s
        assert ticks == pytest.approx(np.round(ticks), abs=1e-3)


def test_rerun_is_on_the_same_specimen(folder: Path) -> None:
    plan = ExperimentPlan(motion("dither", duration_s=3.0), {"position_p_gain": 300}, 0.2)
    first, second = rerun(folder, SECRET, plan), rerun(folder, SECRET, plan)
    for column in ("t_s", "raw"):
        one, two = (r.table.column(column).to_numpy() for r in (first, second))
        assert np.array_equal(one, two, equal_nan=True)
    assert first.metadata["servo"]["1"]["registers"]["position_p_gain"] == 300
    assert first.metadata["condition"]["motion"] == "dither"
    assert first.duration_s == pytest.approx(3.0, abs=0.1)
    bolder = ExperimentPlan(motion("dither", duration_s=3.0, amplitude_rad=0.5), plan.registers)
    groups = {each.metadata["group"] for each in (first, second, rerun(folder, SECRET, bolder))}
    assert len(groups) == 2, "another experiment is no repeat"


def test_rerun_refuses_another_generator(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench.blind.cases, "generator", lambda: "newer")
    with pytest.raises(SealError, match="another version of the generator"):
        rerun(folder, SECRET, ExperimentPlan(motion("hold")))


def test_folder_that_is_there_is_not_touched(folder: Path) -> None:
    with pytest.raises(FileExistsError, match="is there already"):
        write_case(folder, 1, SECRET)


def test_case_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(bench.blind.drafts, "robot_toml", fail)
    with pytest.raises(KeyboardInterrupt):
        write_case(tmp_path / "half", 7, SECRET, NULL)
    assert list(tmp_path.iterdir()) == []


def test_servos_are_built_in_all_ways_and_a_gear_is_sprung_where_it_is_too_springy() -> None:
    wish = {"rig": "xl330-pendulum", "programme": "slow", "style": "slow"}
    builds = {draw(n, Asked("null", **wish)).ground.build for n in range(20)}  # type: ignore[arg-type]
    assert builds == {Build(a, b) for a in (False, True) for b in (False, True)}
    named = ["joint_compliance"]
    chance = np.random.default_rng(0)
    assert all(bench.blind.case._build(named, chance).sprung for _ in range(10))


def test_a_brief_programme_is_had_for_the_asking_and_drawn_by_no_case() -> None:
    for rig in RIGS.values():
        assert BRIEF not in {programme.name for programme in rig.programmes()}
        brief = rig.by_name()[BRIEF]
        shortest = min(sum(r.plan.motion.duration_s for r in p.runs) for p in rig.programmes())
        assert sum(run.plan.motion.duration_s for run in brief.runs) < shortest
        assert {run.group for run in brief.runs} > set(brief.held_out)
        assert {run.plan.payload_kg for run in brief.runs} == set(rig.payloads_kg)
        assert list(rig.by_name().values()) == [*rig.programmes(), brief]


def test_robot_file_has_the_gears_spring_however_it_is_built(
    folder: Path, key: dict[str, Any]
) -> None:
    rig = RIGS[key["rig"]]
    drive = load_robot(folder / "robot.toml").document["drive"][rig.sheet.model]
    gear = rig.specimen(build=Build(sprung=True)).gear
    assert drive["gear_stiffness_nm_rad"]["value"] == gear.stiffness_nm_rad > 0.0
    assert drive["gear_damping_nm_s_rad"]["value"] == gear.damping_nm_s_rad > 0.0
    assert set(key["build"]) == {"sprung", "presliding"}


@pytest.mark.slow
def test_kinds_have_their_number_of_effects() -> None:
    small = {"ratio": 2.0, "concealment": "plain", "rig": "xl330-pendulum", "programme": "slow"}
    for kind, count in (("null", 0), ("pair", 2), ("stranger", 1), ("deleted", 1)):
        case = draw(5, Asked(kind=kind, **small))  # type: ignore[arg-type]
        assert len(case.hidden) == count
        assert {h.name in STRANGERS for h in case.hidden} <= {kind == "stranger"}
    with pytest.raises(ValueError, match="a case of kind pair has 2 effects"):
        draw(5, Asked(kind="pair", effects=("punch",)))


@pytest.mark.usefixtures("nothing_left")
def test_deleted_case_names_what_the_catalogue_lacks(tmp_path: Path) -> None:
    wish = Asked(kind="deleted", effects=("punch",), ratio=3.0, rig="xl330-pendulum", style="slow")
    folder = write_case(tmp_path / "deleted", 2, SECRET, wish)
    assert read_public(folder)["catalogue_without"] == ["punch"]


@pytest.mark.slow
def test_masked_case_has_a_larger_ordinary_misfit() -> None:
    case = draw(4, Asked(kind="single", effects=("punch",), concealment="masked", ratio=2.0))
    (mask,) = case.ordinary
    assert mask.name in ("gain_error", "payload", "link_mass", "supply_voltage")
    for pin in mask.effect.pins:
        assert getattr(case.nuisances, pin) in (0.0, 1.0)


def test_sub_quantum_case_is_below_the_step() -> None:
    case = draw(
        4, Asked(kind="single", effects=("punch",), concealment="sub_quantum", rig="ax12-turntable")
    )
    (hidden,) = case.hidden
    assert hidden.ratio * noise_floor(case.ground.key) < case.ground.rig.sheet.step_rad


@pytest.mark.slow
def test_overload_that_does_not_trip_in_recordings_for_fitting_is_drawn_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wish = Asked(kind="single", effects=("overload_shutdown",), concealment="plain")
    wish = dataclasses.replace(wish, rig="xl330-turntable", programme="fast", style="slow")
    (hidden,) = draw(5, wish).hidden
    assert hidden.ratio >= hidden.wanted
    monkeypatch.setattr(bench.blind.case, "ratio_fitted", lambda *_: 0.0)
    with pytest.raises(ValueError, match="no case in"):
        draw(5, wish)


FAILED_READS = Asked(
    "single", ("lost_samples",), 5.0, "plain", rig="xl330-pendulum", programme="fast", style="fast"
)


@pytest.mark.slow
def test_reads_fail_in_recordings_for_fitting_where_that_is_hidden(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case = draw(1, FAILED_READS)
    reads = [
        len(observe(case.ground.style, run, case.specimen(run.plan))) * run.repeats
        for run in case.ground.programme.runs
        if run.group not in case.ground.programme.held_out
    ]
    expected = case.hidden[0].size * sum(reads)
    assert expected_failures(case) == pytest.approx(expected)
    assert expected >= STRUCK
    monkeypatch.setattr(bench.blind.case, "DRAWS", 1)
    for least, drawn in ((0.99 * expected, True), (1.01 * expected, False)):
        monkeypatch.setattr(bench.blind.case, "STRUCK", least)
        with nullcontext() if drawn else pytest.raises(ValueError, match="no case in"):
            draw(1, FAILED_READS)


@pytest.mark.slow
def test_an_effect_that_a_mask_takes_away_is_drawn_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    wish = Asked(
        "single", ("torque_limit",), 2.0, "masked", "mx64-pendulum", "fast", programme="slow"
    )
    case = draw(3, wish)
    change = case.fitted_trace(POSITION) - case.without(0).fitted_trace(POSITION)
    assert rms(change) >= THERE * 2.0 * noise_floor(case.ground.key)
    monkeypatch.setattr(bench.blind.case, "THERE", 1e9)
    monkeypatch.setattr(bench.blind.case, "DRAWS", 1)
    with pytest.raises(ValueError, match="no case in"):
        draw(3, wish)


@pytest.mark.usefixtures("nothing_left")
@pytest.mark.slow
def test_mimicked_case_names_its_rival(tmp_path: Path) -> None:
    wish = Asked(
        kind="single",
        effects=("read_skew",),
        ratio=3.0,
        concealment="mimicked",
        rig="xl330-turntable",
        programme="fast",
        style="slow",
    )
    key = open_key(write_case(tmp_path / "mimic", 2, SECRET, wish), SECRET)
    assert key["rival"]["effect"] == "transport_delay"
    assert 0.0 < key["rival"]["unlike"] < ALIKE


@pytest.mark.slow
def test_case_whose_rivals_are_unlike_is_not_called_mimicked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bench.blind.case, "DRAWS", 2)
    key = Key("xl330-turntable", "fast", "slow")
    at = size_for(key, "backlash", 3.0, Setting())
    assert at is not None
    found = nearest_rival(key, "backlash", at, Setting())
    assert found is not None
    assert found.unlike > ALIKE
    wish = {"rig": key[0], "programme": key[1], "style": key[2], "ratio": 3.0}
    with pytest.raises(ValueError, match="or no rival is like it"):
        draw(1, Asked(kind="single", effects=("backlash",), concealment="mimicked", **wish))


@pytest.mark.slow
def test_disguise_brings_the_raw_misfit_to_a_nulls() -> None:
    case = draw(
        11,
        Asked(
            kind="single",
            effects=("dead_zone",),
            ratio=3.0,
            concealment="plain",
            rig="xl330-pendulum",
            programme="slow",
            style="slow",
            disguise=True,
        ),
    )
    changed, told = disguise(case)
    plain, nothing = disguise(draw(7, WISH))
    assert told["matched"] == (abs(told["rmse_rad"] / told["rmse_null_rad"] - 1.0) <= 0.10)
    assert 0.9 <= changed.nuisances.torque_constant_factor <= 1.1
    assert nothing == {}
    assert not plain.disguised


def test_key_is_plain_json_without_infinities(key: dict[str, Any]) -> None:
    def finite(document: object) -> bool:
        return all(math.isfinite(n) for n in numbers(document))

    assert finite(key)
    assert key["effects"][0]["effect"] == "dead_zone"
    assert key["effects"][0]["wanted_ratio"] == 8.0
    assert key["effects"][0]["parameters"]["margin_rad"]["unit"] == "rad"


@pytest.mark.parametrize("what", ["rig", "style", "programme"])
def test_unknown_wish_is_refused_with_what_there_is(what: str) -> None:
    with pytest.raises(ValueError, match=f"no {what} named 'moon': use one of "):
        draw(1, Asked(**{what: "moon"}))
