"""A file that is cut, garbled or nonsense gets one clear error or a recording: no traceback."""

import json
from pathlib import Path

import pytest
from foreign_logs import MAKERS, bam_entries, bam_log, lines, pair, telemetry
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.importers import open_recordings
from bench.recording import Recording, RecordingError, oddities

MANGLED = settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def opened(path):
    """The error, or ``None`` for a recording that can be looked through; else the test fails."""
    try:
        found = open_recordings([path])
    except RecordingError as error:
        told = error
    else:
        for recording in found:
            assert isinstance(recording, Recording)
            oddities(recording)
        return None
    assert str(path.parent) in str(told)
    assert "\n" not in str(told)
    return told


@MANGLED
@given(
    name=st.sampled_from(sorted(MAKERS)),
    place=st.floats(0.0, 1.0),
    cut=st.integers(0, 40),
    bytes_in=st.binary(max_size=12),
)
def test_bytes_replaced_anywhere(tmp_path_factory, name, place, cut, bytes_in):
    path = MAKERS[name](tmp_path_factory.mktemp("mangled"))
    data = path.read_bytes()
    at = int(place * len(data))
    path.write_bytes(data[:at] + bytes_in + data[at + cut :])
    opened(path)


@MANGLED
@given(
    name=st.sampled_from(sorted(set(MAKERS) - {"so101", "bam"})),
    row=st.integers(0, 41),
    column=st.integers(0, 9),
    cell=st.sampled_from(
        ["", "nan", "inf", "-1e300", "1e9", "abc", "0.5", "-40000", '"', "٣", "1,2"]
    ),
)
def test_a_cell_replaced(tmp_path_factory, name, row, column, cell):
    path = MAKERS[name](tmp_path_factory.mktemp("mangled"))
    rows = [line.split(",") for line in path.read_text().splitlines()]
    cells = rows[row % len(rows)]
    cells[column % len(cells)] = cell
    lines(path, *(",".join(line) for line in rows))
    opened(path)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=5,
)


@MANGLED
@given(
    key=st.sampled_from(
        ["mass", "length", "kp", "vin", "motor", "trajectory", "arm_mass", "entries"]
    ),
    value=JSON,
)
def test_a_pendulums_facts_replaced_by_any_json(tmp_path_factory, key, value):
    folder = tmp_path_factory.mktemp("mangled")
    opened(bam_log(folder / "log.json", **({key: value} if value is not None else {})))


@MANGLED
@given(field=st.sampled_from(sorted(bam_entries(1)[0])), row=st.integers(0, 19), value=JSON)
def test_a_pendulums_sample_replaced_by_any_json(tmp_path_factory, field, row, value):
    folder = tmp_path_factory.mktemp("mangled")
    entries = bam_entries(20)
    entries[row][field] = value
    opened(bam_log(folder / "log.json", entries))


@MANGLED
@given(cell=st.text(max_size=20) | JSON.map(json.dumps), row=st.integers(1, 39))
def test_a_list_of_joints_replaced_by_any_text(tmp_path_factory, cell, row):
    control = pair(tmp_path_factory.mktemp("mangled") / "motion", packed=False)
    rows = control.read_text().splitlines()
    rows[row] = f'CONTROL,{row}.0,"{cell.replace(chr(34), chr(39))}"'
    control.write_text("\n".join(rows) + "\n")
    opened(control)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "the file is empty"),
        (b"\x00\x01\x02\xff", "known formats: say what its columns are in log.columns.toml"),
        (b'{"entries": [], "timestamp": 0}', "entries is no list of samples"),
        (b'{"entries": [{"timestamp": 0', "not JSON"),
        (b"time_us,reg30,reg30\n0,1,2\n", "column 'reg30' is there twice"),
        (b"time_us,reg30\n", "no rows below the header"),
        (b"time_us,reg30\n0,1,2\n", "row 1 "),
        (b"time_us,reg30\n0,1\n,2\n", "row 2 (line 3 with the header): time_us is missing"),
        (b"time_us,reg30\n0,900\n", "is no byte"),
        (b"time_us,reg30\n0,x\n", "'x' is not a number"),
    ],
)
def test_the_error_says_what_is_wrong(tmp_path, content, says):
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    error = opened(path)
    assert isinstance(error, RecordingError)
    assert says in str(error)


def test_a_cut_gzip_file_says_so(tmp_path):
    control = pair(tmp_path / "motion")
    control.write_bytes(control.read_bytes()[:-20])
    error = opened(control)
    assert "not a complete gzip file" in str(error)


def test_a_time_that_is_none_is_told_with_its_row(tmp_path):
    path = telemetry(tmp_path / "telemetry.csv")
    path.write_text(path.read_text().replace("2025-11-09T09:27:04.500Z", "yesterday"))
    error = opened(path)
    assert "row 7 (line 8 with the header): timestamp 'yesterday' is no ISO 8601 time" in str(error)


def test_a_file_that_is_too_large_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("bench.importers.source.LARGEST_BYTES", 1000)
    error = opened(pair(tmp_path / "motion", rows=400))
    assert "split it into parts" in str(error)


def test_a_log_that_does_not_fit_into_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("bench.recording.size.free_bytes", lambda: 10_000)
    error = opened(MAKERS["dump"](tmp_path))
    assert "GiB are free: split the recording" in str(error)


def test_a_missing_file_is_an_os_error(tmp_path):
    with pytest.raises(OSError, match="nowhere"):
        open_recordings([Path(tmp_path / "nowhere.json")])
