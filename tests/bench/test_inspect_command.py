"""``busemu inspect`` and ``busemu import``, as a person types them."""

from math import nan

import numpy as np
import pytest
from matplotlib import image
from programs import busemu
from recording_samples import MARVIN, read_row, sample

from bench.figures.recording import MOST_POINTS, thinned
from bench.importers import open_recordings
from bench.recording import Recording, RecordingError, read, write


def telemetry(path, rows=80):
    text = "timestamp,target pos (5),pos (5),temp (5)\n"
    for i in range(rows):
        text += f"2025-11-09T09:27:{i * 0.1:06.3f}Z,{2047 + i},{2040 + i},{90 if i == 40 else 30}\n"
    path.write_text(text)
    return path


def test_a_foreign_log_is_looked_into_as_it_is(tmp_path):
    done = busemu("inspect", telemetry(tmp_path / "log.csv"))
    assert done.returncode == 0, done.stderr
    assert "sts3215-lever" in done.stdout
    assert "out of line with those before and after" in done.stdout
    assert "servo 5 present_temperature, 4.000 s" in done.stdout
    assert "try next  busemu inspect" in done.stdout


def test_pictures_are_written_whole(tmp_path):
    path = write(sample(), tmp_path / "walk.parquet")
    done = busemu("inspect", path, "--out", tmp_path / "pictures")
    assert done.returncode == 0, done.stderr
    written = sorted(p.name for p in (tmp_path / "pictures").iterdir())
    assert written == ["sample-intervals.png", "sample-motion.png"]
    for name in written:
        pixels = image.imread(tmp_path / "pictures" / name)
        assert pixels.shape[0] > 200
        assert np.ptp(pixels) > 0


def test_many_recordings_make_an_overview(tmp_path):
    for i in range(7):
        write(sample(name=f"walk{i}"), tmp_path / f"walk{i}.parquet")
    done = busemu("inspect", tmp_path)
    assert done.returncode == 0, done.stderr
    assert all(f"walk{i} " in done.stdout for i in range(7))
    assert "7 recordings: " in done.stdout


def test_an_overview_says_which_file_to_look_into_first(tmp_path):
    lost = {2: 1, 4: 9}
    for k in range(7):
        raw = [nan if n < lost.get(k, 0) else 500 + n % 90 for n in range(400)]
        reads = [read_row(0.01 * n, 1, value) for n, value in enumerate(raw)]
        write(Recording.of(reads, MARVIN | {"name": f"walk{k}"}), tmp_path / f"walk{k}.parquet")
    done = busemu("inspect", tmp_path)
    assert f"what to do: busemu inspect {tmp_path / 'walk4.parquet'}\n" in done.stdout


def test_an_overview_names_a_kind_once_however_it_weighs(tmp_path):
    for lost in range(7):
        reads = [read_row(0.01 * k, 1, nan if k < lost else 500 + k % 90) for k in range(400)]
        write(
            Recording.of(reads, MARVIN | {"name": f"walk{lost}"}), tmp_path / f"walk{lost}.parquet"
        )
    done = busemu("inspect", tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("lost_replies in") == 1
    assert "lost_replies in 6" in done.stdout


def test_a_robot_of_the_command_line_is_that_of_recordings_that_name_an_unknown_one(tmp_path):
    path = write(sample(robot="nobody"), tmp_path / "walk.parquet")
    assert "'nobody' is not known here" in busemu("inspect", path).stdout
    assert "is not known here" not in busemu("inspect", path, "--robot", "marvin").stdout
    (known,) = open_recordings([write(sample(), tmp_path / "own.parquet")], "phantomx")
    assert known.robot.name == "marvin"


def test_a_wrong_file_among_others_is_named_and_the_others_are_shown(tmp_path):
    bad = tmp_path / "bad.parquet"
    bad.write_bytes(b"no parquet")
    good = write(sample(), tmp_path / "good.parquet")
    done = busemu("inspect", bad, good)
    assert done.returncode == 1
    assert done.stderr.startswith("busemu: ")
    assert "bad.parquet" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert "sample: marvin" in done.stdout


def test_import_writes_recordings_that_read_back(tmp_path):
    telemetry(tmp_path / "log.csv")
    done = busemu("import", "auto", tmp_path / "log.csv", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "1 recording, 161 rows" not in done.stdout  # 80 targets, 80 positions, 80 temperatures
    assert "1 recording, 240 rows" in done.stdout
    assert f"try next  busemu inspect {tmp_path / 'out'}" in done.stdout
    recording = read(tmp_path / "out" / "log.parquet")
    assert recording.metadata["import"]["format"] == "telemetry"
    assert len(recording.series(5, "present_position").value) == 80


def test_files_of_one_name_do_not_overwrite_each_other(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        telemetry(tmp_path / folder / "log.csv")
    done = busemu("import", "telemetry", tmp_path / "a", tmp_path / "b", "--out", tmp_path, "--csv")
    assert done.returncode == 0, done.stderr
    assert {p.name for p in tmp_path.glob("*.csv")} == {"log.csv", "log-2.csv"}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["import", "word", "x.csv", "--out", "o"], "no format 'word': use auto or one of bam"),
        (["import", "auto", "nowhere.csv", "--out", "o"], "nowhere.csv"),
        (["inspect", "nowhere.parquet"], "nowhere.parquet"),
        (["import", "wide-csv", "log.csv", "--out", "o"], "log.columns.toml: there is no such map"),
        (["import", "bam", "log.csv", "--out", "o"], "not JSON"),
    ],
)
def test_bad_words_get_one_clear_line(tmp_path, words, says):
    telemetry(tmp_path / "log.csv")
    placed = [str(tmp_path / w) if w in ("log.csv", "o") else w for w in words]
    done = busemu(*placed)
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stderr.startswith("busemu: ")
    assert says in done.stderr


def test_a_recording_that_does_not_fit_into_memory_is_refused_unread(tmp_path, monkeypatch):
    for path in (tmp_path / "walk.parquet", tmp_path / "walk.csv"):
        write(sample(), path)
        monkeypatch.setattr("bench.recording.size.free_bytes", lambda: 10_000)
        with pytest.raises(RecordingError, match=r"rows need .* GiB of memory"):
            read(path)
        monkeypatch.setattr("bench.recording.size.free_bytes", lambda: None)
        assert len(read(path)) == len(sample())


def test_a_long_line_is_thinned_to_its_extremes():
    t_s = np.linspace(0.0, 100.0, 300_000)
    values = np.sin(t_s)
    values[123_456] = 9.0
    times, kept = thinned(t_s, values)
    assert len(kept) <= MOST_POINTS
    assert kept.max() == 9.0
    assert kept.min() == values.min()
    assert times[int(np.argmax(kept))] == pytest.approx(t_s[123_456], abs=0.02)
