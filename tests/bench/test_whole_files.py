"""A file is whole or not there, whatever ends the writing; JSON is such as others can read."""

import csv
import errno
import io
import json
import math
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

from bench.figures.style import save
from bench.files import finite, replacing, write_csv, write_json, write_text

KILLED = """
import os, signal, sys
from pathlib import Path
from bench.files import replacing
with replacing(Path(sys.argv[1])) as file:
    file.write(b"half of the ne")
    file.flush()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_kill_half_way_leaves_the_old_file_and_only_a_hidden_part(tmp_path):
    path = tmp_path / "told.json"
    write_text(path, "the old text\n")
    killed = subprocess.run([sys.executable, "-c", KILLED, str(path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert path.read_text() == "the old text\n"
    (part,) = set(names(tmp_path)) - {"told.json"}
    assert part.startswith(".told.json.")
    assert part.endswith(".part")


def test_the_file_stays_as_it_was_until_all_is_written(tmp_path):
    path = tmp_path / "told.txt"
    write_text(path, "old")
    with replacing(path) as file:
        file.write(b"new")
        file.flush()
        assert path.read_text() == "old"
        assert names(path.parent) == [f".told.txt.{os.getpid()}.part", "told.txt"]
    assert path.read_text() == "new"
    assert names(tmp_path) == ["told.txt"]


@pytest.mark.parametrize("fault", [OSError("disk full"), KeyboardInterrupt()])
def test_an_error_leaves_the_old_file_and_no_part(tmp_path, fault):
    path = tmp_path / "told.txt"
    write_text(path, "old")

    def fill():
        with replacing(path) as file:
            file.write(b"half")
            raise fault

    with pytest.raises(type(fault)):
        fill()
    assert path.read_text() == "old"
    assert names(tmp_path) == ["told.txt"]


def test_an_error_of_the_disk_bears_the_name_of_the_file(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(FileNotFoundError) as missing:
        write_text(tmp_path / "nowhere" / "told.txt", "text")
    assert missing.value.filename == str(tmp_path / "nowhere" / "told.txt")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space") as none_left:
        write_text(tmp_path / "told.txt", "text")
    assert none_left.value.filename == str(tmp_path / "told.txt")


def test_bytes_are_on_the_disk_before_they_take_the_name(tmp_path, monkeypatch):
    path, seen = tmp_path / "told.txt", []
    fsync = os.fsync

    def look(descriptor):
        fsync(descriptor)
        seen.append(path.exists())

    monkeypatch.setattr(os, "fsync", look)
    write_text(path, "text")
    assert seen == [False, True]  # the bytes, then the folder with the name


def test_text_is_utf_8_and_its_line_ends_stay(tmp_path):
    write_text(tmp_path / "told.txt", "a\r\nč\n")
    assert (tmp_path / "told.txt").read_bytes() == "a\r\nč\n".encode()


def test_json_has_numpys_numbers_and_letters_as_they_are(tmp_path):
    write_json(tmp_path / "told.json", {"č": np.float32(0.5), "n": [np.float64(2.0), 3]})
    text = (tmp_path / "told.json").read_text("utf-8")
    assert "č" in text
    assert text.endswith("}\n")
    assert json.loads(text) == {"č": 0.5, "n": [2.0, 3]}


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, np.float32("nan")])
def test_a_number_that_json_lacks_is_refused_and_changes_nothing(tmp_path, number):
    write_json(tmp_path / "told.json", {"a": 1.0})
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "told.json", {"a": [number]})
    assert json.loads((tmp_path / "told.json").read_text()) == {"a": 1.0}
    assert names(tmp_path) == ["told.json"]


def test_finite_makes_null_of_numbers_that_json_lacks_and_keeps_all_others():
    told = {"a": (math.nan, 1.0), "b": {"c": -math.inf, "d": "nan"}, "e": True, "f": None}
    assert finite(told) == {"a": [None, 1.0], "b": {"c": None, "d": "nan"}, "e": True, "f": None}


def test_a_table_has_a_header_and_cells_that_come_back(tmp_path):
    write_csv(tmp_path / "told.csv", ("name", "value"), [("a, b", 0.1), ('c "d"', None)])
    text = (tmp_path / "told.csv").read_bytes().decode()
    assert list(csv.reader(io.StringIO(text))) == [
        ["name", "value"],
        ["a, b", "0.1"],
        ['c "d"', ""],
    ]
    assert "\r" not in text


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_a_picture_that_fails_half_way_leaves_the_old_one(tmp_path, monkeypatch, suffix):
    path = tmp_path / f"drawn{suffix}"
    save(Figure(), path)
    before = path.read_bytes()

    def fail(figure, file, **_):
        file.write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(Figure, "savefig", fail)
    with pytest.raises(OSError, match="disk full"):
        save(Figure(), path)
    assert path.read_bytes() == before
    assert names(tmp_path) == [path.name]
