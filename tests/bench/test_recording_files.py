"""Both encodings bring back the same bits, and a file is whole or not there."""

import contextlib
import datetime
import os
import signal
import subprocess
import sys
import time
from math import nan
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recording_samples import MARVIN, Row, read_row, same_bits, sample, table, write_row

from bench.recording import Recording, RecordingError, check_path, read, write

ENCODINGS = ["walk.parquet", "walk.csv"]
UNKNOWN = {
    "lab": {"room": "E-126", "temperature_degC": 21.5, "people": ["a", 'b "c"', "č\n"]},
    "when": datetime.datetime(2019, 5, 20, 12, 30, tzinfo=datetime.UTC),
    "condition": {"support": "ground", "payload_kg": 0.092, "odd key": [1, 2, {"x": True}]},
}


@pytest.mark.parametrize("name", ENCODINGS)
def test_round_trip_keeps_every_bit_and_every_unknown_key(tmp_path, name):
    lost = read_row(10.5, 3, nan)
    mocap = Row(10.6, 10.6, 0, "read", "mocap/base_z_m", -0.1 + 1e-17)
    taken = Recording.of([write_row(10.1, 3, 512), lost, mocap], MARVIN | UNKNOWN)
    path = write(taken, tmp_path / name)
    again = read(path)
    assert path == tmp_path / name
    assert same_bits(taken, again)
    assert again.metadata["lab"] == UNKNOWN["lab"]
    assert again.metadata["when"] == UNKNOWN["when"]


@pytest.mark.parametrize("name", ENCODINGS)
def test_the_optional_latch_time_and_unknown_columns_come_back(tmp_path, name):
    more = table(t_latch_s=[0.01, nan, 0.2], note=["a", "b, c", 'd "e"'], weight=[1.5, 2.5, nan])
    taken = Recording.checked(more, MARVIN)
    again = read(write(taken, tmp_path / name))
    assert again.table.column_names[-3:] == ["t_latch_s", "note", "weight"]
    assert same_bits(taken, again)


@pytest.mark.parametrize("name", ENCODINGS)
def test_an_empty_recording_round_trips(tmp_path, name):
    taken = Recording.of([], MARVIN)
    again = read(write(taken, tmp_path / name))
    assert len(again) == 0
    assert same_bits(taken, again)


numbers = st.floats(allow_nan=False, allow_infinity=False)
texts = st.text(max_size=8)
values = st.recursive(
    st.booleans() | st.integers(-(2**63), 2**63 - 1) | numbers | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=6,
)
accesses = st.builds(
    lambda t, delay, servo, what, raw: Row(t, t + delay, servo, *what, raw),
    numbers,
    st.floats(0, 1) | st.just(nan),
    st.integers(1, 252),
    st.sampled_from([("write", "goal_position"), ("read", "present_position")]),
    st.integers(0, 65535),
)
observations = st.builds(
    lambda t, name, raw: Row(t, t, 0, "read", f"x/{name}", raw),
    numbers,
    st.text(min_size=1, max_size=8),
    numbers | st.just(nan),
)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    rows=st.lists(accesses | observations, max_size=12),
    more=st.dictionaries(texts.map("my_".__add__), values, max_size=4),
)
def test_any_recording_round_trips_through_both_encodings(tmp_path, rows, more):
    taken = Recording.of(rows, MARVIN | more)
    for name in ENCODINGS:
        assert same_bits(taken, read(write(taken, tmp_path / name)))


def test_times_as_far_apart_as_can_be_are_sorted(tmp_path):
    """More seconds lie between them than a number can tell."""
    far = sys.float_info.max
    taken = Recording.of([write_row(-far, 3, 512), write_row(far, 3, 512)], MARVIN)
    assert same_bits(taken, read(write(taken, tmp_path / "walk.parquet")))


def test_parquet_carries_the_metadata_as_toml_under_its_key(tmp_path):
    path = write(sample(), tmp_path / "walk.parquet")
    text = pq.read_schema(path).metadata[b"busemu-recording"].decode()
    assert 'format = "busemu-recording/1"' in text
    assert 'robot = "marvin"' in text


def test_csv_is_plain_enough_for_a_spreadsheet(tmp_path):
    path = write(Recording.of([write_row(0.25, 3, 512)], MARVIN), tmp_path / "walk.csv")
    assert path.read_text() == (
        "t_s,t_reply_s,servo_id,op,register,raw\n0.25,nan,3,write,goal_position,512\n"
    )
    assert path.with_suffix(".toml").is_file()


def test_a_csv_from_a_spreadsheet_is_read(tmp_path):
    """A byte order mark, carriage returns, empty cells for NaN, columns in another order."""
    (tmp_path / "walk.csv").write_bytes(
        b"\xef\xbb\xbfservo_id,t_s,t_reply_s,op,register,raw\r\n"
        b'3,0.5,,"write",goal_position,512\r\n3,0.6,NaN,read,present_position,\r\n'
    )
    (tmp_path / "walk.toml").write_bytes(
        b'\xef\xbb\xbfformat = "busemu-recording/1"\r\nrobot = "marvin"\r\n'
    )
    again = read(tmp_path / "walk.csv")
    wanted = Recording.of([write_row(0.5, 3, 512), read_row(0.6, 3, nan)], again.metadata)
    assert same_bits(again, wanted)


def test_either_file_of_a_pair_may_be_named(tmp_path):
    write(sample(), tmp_path / "walk.csv")
    assert same_bits(read(tmp_path / "walk.toml"), read(tmp_path / "walk.csv"))


def test_parquet_of_foreign_types_is_read(tmp_path):
    """Other tools write float32, int64, large strings and nulls."""
    foreign = table(
        t_s=pa.array([0.0, 0.5, 1.0], pa.float32()),
        t_reply_s=pa.array([None, 0.75, 1.5]),
        op=pa.array(["write", "read", "read"], pa.large_string()),
        raw=pa.array([1, 2, None], pa.int64()),
    )
    text = b'format = "busemu-recording/1"'
    pq.write_table(
        foreign.replace_schema_metadata({b"busemu-recording": text}), tmp_path / "f.parquet"
    )
    again = read(tmp_path / "f.parquet")
    np.testing.assert_array_equal(again.table["raw"].to_numpy(), [1.0, 2.0, nan])
    np.testing.assert_array_equal(again.table["t_reply_s"].to_numpy(), [nan, 0.75, 1.5])


def test_many_chunks_are_one_recording(tmp_path):
    parts = pa.concat_tables([table(), table(t_s=[1.0, 1.1, 1.2], op=["read", "write", "read"])])
    taken = Recording.checked(parts, {"format": MARVIN["format"]})
    assert taken.table["op"].num_chunks == 1
    assert len(taken.rows(1, "goal_position")) == 2
    assert same_bits(taken, read(write(taken, tmp_path / "walk.parquet")))


@pytest.mark.parametrize("name", ENCODINGS)
def test_writing_replaces_and_leaves_nothing_else_behind(tmp_path, name):
    write(sample(name="first"), tmp_path / name)
    write(sample(name="second"), tmp_path / name)
    assert read(tmp_path / name).name == "second"
    beside = ["walk.toml"] if name.endswith("csv") else []
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([name, *beside])


@pytest.mark.parametrize("name", ENCODINGS)
@pytest.mark.parametrize("fault", [OSError("disk full"), KeyboardInterrupt()])
def test_a_write_that_fails_changes_nothing(tmp_path, monkeypatch, name, fault):
    write(sample(name="first"), tmp_path / name)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def fail(table, *rest):
        rest[-1].write(b"half")
        raise fault

    monkeypatch.setattr("bench.recording.csv_table.save", fail)
    monkeypatch.setattr("bench.recording.parquet_table.save", fail)
    with pytest.raises(type(fault)):
        write(sample(name="second"), tmp_path / name)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_a_table_never_stands_beside_missing_or_foreign_metadata(tmp_path, monkeypatch):
    write(sample(name="first"), tmp_path / "walk.csv")
    seen = []
    rename = Path.replace

    def look(part, path):
        rename(part, path)
        csv, toml = tmp_path / "walk.csv", tmp_path / "walk.toml"
        seen.append((path.name, csv.exists(), toml.exists() and "second" in toml.read_text()))

    monkeypatch.setattr(Path, "replace", look)
    write(sample(name="second"), tmp_path / "walk.csv")
    assert seen == [("walk.toml", False, True), ("walk.csv", True, True)]


WRITER = """
import sys
import numpy as np, pyarrow as pa
from bench.recording import Recording, write
n = 1_500_000
text = lambda value: pa.DictionaryArray.from_arrays(np.zeros(n, np.int32), pa.array([value]))
columns = {
    "t_s": np.arange(n) * 1e-3, "t_reply_s": np.random.default_rng(0).random(n) + n,
    "servo_id": np.ones(n, np.int16), "op": text("read"), "register": text("present_position"),
    "raw": np.full(n, 512.0),
}
taken = Recording.checked(pa.table(columns), {"format": "busemu-recording/1"})
print("writing", flush=True)
write(taken, sys.argv[1])
"""


@pytest.mark.parametrize("name", ENCODINGS)
def test_kill_9_while_writing_leaves_no_half_file(tmp_path, name):
    """Killed with bytes on the disk and the name not yet given: the name must not be there."""
    child = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path / name)], stdout=subprocess.PIPE
    )
    assert child.stdout.readline() == b"writing\n"
    until = time.monotonic() + 60.0
    begun = False
    while not begun and child.poll() is None and time.monotonic() < until:
        with contextlib.suppress(FileNotFoundError):  # it took its name since it was listed
            begun = any(p.stat().st_size for p in tmp_path.iterdir() if p.suffix == ".part")
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    child.stdout.close()
    assert begun
    if child.returncode == -signal.SIGKILL and any(tmp_path.glob(".*.part")):
        assert not (tmp_path / name).exists()
    else:  # it was faster than the kill
        assert len(read(tmp_path / name)) == 1_500_000


def test_a_file_cut_short_is_refused(tmp_path):
    path = write(sample(), tmp_path / "walk.parquet")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(RecordingError, match=r"walk\.parquet: not a complete Parquet file"):
        read(path)


def test_parquet_without_the_key_is_refused(tmp_path):
    pq.write_table(table(), tmp_path / "bare.parquet")
    with pytest.raises(RecordingError, match=r"bare\.parquet.*'busemu-recording'"):
        read(tmp_path / "bare.parquet")


@pytest.mark.parametrize(
    ("kept", "missing"), [("walk.csv", "walk.toml"), ("walk.toml", "walk.csv")]
)
def test_half_a_pair_is_refused(tmp_path, kept, missing):
    write(sample(), tmp_path / "walk.csv")
    (tmp_path / missing).unlink()
    with pytest.raises(RecordingError, match=rf"{kept}: {missing} is missing"):
        read(tmp_path / "walk.csv")


def test_a_file_that_is_not_there_is_an_os_error(tmp_path):
    for name in ENCODINGS:
        with pytest.raises(FileNotFoundError):
            read(tmp_path / name)


def test_other_names_are_refused(tmp_path):
    for call in (read, check_path, lambda path: write(sample(), path)):
        with pytest.raises(RecordingError, match=r"ends in \.parquet or \.csv"):
            call(tmp_path / "walk.xlsx")


def test_a_place_that_cannot_be_written_is_told_before_the_run(tmp_path):
    assert check_path(tmp_path / "walk.csv") == tmp_path / "walk.csv"
    with pytest.raises(RecordingError, match="there is no folder"):
        check_path(tmp_path / "nowhere" / "walk.csv")


def test_what_toml_has_no_word_for_is_refused_by_its_key(tmp_path):
    with pytest.raises(RecordingError, match=r"metadata condition\.mass\[1\] = None"):
        sample(condition={"mass": [1.0, None]})
