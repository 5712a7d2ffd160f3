"""What is refused, and that a refusal says the file, the row and the rule."""

from math import inf, nan

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest
import tomli_w
from recording_samples import FORMAT, MARVIN, table

from bench.recording import Recording, RecordingError, read


def refused(tmp_path, columns, metadata=MARVIN):
    """The error that both encodings of a table with these columns are refused with."""
    taken = table(**columns)
    pyarrow.csv.write_csv(taken, tmp_path / "walk.csv")
    (tmp_path / "walk.toml").write_text(tomli_w.dumps(metadata))
    key = {b"busemu-recording": tomli_w.dumps(metadata).encode()}
    pq.write_table(taken.replace_schema_metadata(key), tmp_path / "walk.parquet")
    found = []
    for name in ("walk.parquet", "walk.csv"):
        with pytest.raises(RecordingError) as caught:
            read(tmp_path / name)
        assert caught.value.path == tmp_path / name
        assert str(tmp_path / name) in str(caught.value)
        found.append(caught.value)
    parquet, csv = found
    assert (parquet.row, parquet.rule) == (csv.row, csv.rule)
    return csv


RAW = "raw"
ROWS = [
    ("unsorted", {"t_s": [0.0, 0.2, 0.1]}, 3, "unsorted times: t_s 0.1 comes after 0.2"),
    ("no time", {"t_s": [0.0, nan, 0.1]}, 2, "t_s nan is no time"),
    ("endless time", {"t_s": [0.0, 0.1, inf]}, 3, "t_s inf is no time"),
    ("endless reply", {"t_reply_s": [nan, inf, 0.1]}, 2, "t_reply_s is infinite"),
    ("bad op", {"op": ["write", "reed", "read"]}, 2, "op 'reed' is neither 'read' nor 'write'"),
    ("no op", {"op": ["write", "read", ""]}, 3, "op '' is neither"),
    ("negative id", {"servo_id": [1, -1, 2]}, 2, "servo_id -1 is no ID on a bus: 0 to 254"),
    ("high id", {"servo_id": [1, 1, 255]}, 3, "servo_id 255 is no ID on a bus"),
    (
        "unknown register of a known model",
        {"register": ["goal_position", "present_position", "present_current"]},
        3,
        "unknown register: servo 2 is XL-320, which has no 'present_current'",
    ),
    (
        "no register",
        {"register": ["", "a/b", "a/b"], "servo_id": [9, 0, 0]},
        1,
        "register is empty",
    ),
    (
        "namespace on the bus",
        {"register": ["goal_position", "imu/roll_rad", "present_position"]},
        2,
        "'imu/roll_rad' is not on the bus (it has a namespace): its servo_id must be 0, not 1",
    ),
    ("raw too large", {RAW: [512.0, 65536.0, 1.0]}, 2, "raw 65536 is outside present_position"),
    ("raw negative", {RAW: [512.0, 1.0, -1.0]}, 3, "raw -1 is outside present_position of servo 2"),
    ("raw in SI", {RAW: [0.5236, 1.0, 1.0]}, 1, "raw 0.5236 is outside goal_position of servo 1"),
    ("raw endless", {RAW: [1.0, inf, 1.0]}, 2, "raw inf of present_position is no value"),
    ("write of nothing", {RAW: [nan, 1.0, 1.0]}, 1, "raw of a write to goal_position is missing"),
]


@pytest.mark.parametrize(
    ("columns", "row", "rule"), [case[1:] for case in ROWS], ids=[case[0] for case in ROWS]
)
def test_a_row_that_breaks_a_rule_is_refused(tmp_path, columns, row, rule):
    error = refused(tmp_path, columns)
    assert error.row == row
    assert rule in error.rule
    assert f"walk.csv: row {row} (line {row + 1} with the header): {error.rule}" in str(error)


def test_the_bound_is_that_of_the_registers_bytes(tmp_path):
    names = ["p_gain", "present_position", "present_position"]
    error = refused(tmp_path, {"register": names, "raw": [256.0, 1.0, 1.0]})
    assert "from 0 to 255" in error.rule
    Recording.checked(table(register=names, raw=[255.0, 65535.0, 0.0]), MARVIN)


@pytest.mark.parametrize("column", ["t_s", "t_reply_s", "servo_id", "op", "register", "raw"])
def test_a_missing_column_is_refused(tmp_path, column):
    error = refused(tmp_path, {column: None})
    assert error.row is None
    assert error.rule.startswith(f"missing column {column} (found: ")


@pytest.mark.parametrize(
    ("column", "cells", "rule"),
    [
        ("t_s", ["0.0", "0.1", "later"], "t_s 'later' is not a number"),
        ("raw", ["1", "2", "0x10"], "raw '0x10' is not a number"),
        ("servo_id", ["1", "1", "tibia"], "servo_id 'tibia' is not the ID of a servo"),
    ],
)
def test_a_cell_that_is_no_number_is_refused(tmp_path, column, cells, rule):
    error = refused(tmp_path, {column: cells})
    assert error.row == 3
    assert rule in error.rule


@pytest.mark.parametrize(
    ("column", "cells"), [("servo_id", [1, None, 2]), ("op", ["read", None, "x"])]
)
def test_an_empty_cell_that_must_be_filled_is_refused(column, cells):
    with pytest.raises(RecordingError, match=rf"row 2: {column} is empty"):
        Recording.checked(table(**{column: pa.array(cells)}), MARVIN)


def test_a_row_of_too_few_cells_is_refused_with_its_row(tmp_path):
    (tmp_path / "walk.csv").write_text(
        "t_s,t_reply_s,servo_id,op,register,raw\n0,nan,1,write,goal_position,1\n1,nan,1\n"
    )
    (tmp_path / "walk.toml").write_text(f'format = "{FORMAT}"')
    with pytest.raises(RecordingError, match=r"walk\.csv: row 2 .*3 cells under 6 columns"):
        read(tmp_path / "walk.csv")


@pytest.mark.parametrize("text", ["", "t_s;t_reply_s;servo_id;op;register;raw\n0;1;2;read;x;3\n"])
def test_a_csv_that_is_no_event_table_is_refused(tmp_path, text):
    (tmp_path / "walk.csv").write_text(text)
    (tmp_path / "walk.toml").write_text(f'format = "{FORMAT}"')
    with pytest.raises(RecordingError, match=r"missing column t_s, .*separated by commas"):
        read(tmp_path / "walk.csv")


def test_a_doubled_column_is_refused():
    doubled = table().append_column("raw", pa.array([1.0, 2.0, 3.0]))
    with pytest.raises(RecordingError, match="column raw is there twice"):
        Recording.checked(doubled, MARVIN)


@pytest.mark.parametrize("found", [None, "busemu-recording/2", 1])
def test_a_wrong_format_is_refused(tmp_path, found):
    metadata = {} if found is None else {"format": found}
    error = refused(tmp_path, {}, metadata)
    assert f'needs the line format = "{FORMAT}"' in error.rule
    assert ("has no format" if found is None else f"not {found!r}") in error.rule


def test_metadata_that_is_not_toml_is_refused(tmp_path):
    pyarrow.csv.write_csv(table(), tmp_path / "walk.csv")
    (tmp_path / "walk.toml").write_text("format = busemu")
    with pytest.raises(RecordingError, match=r"walk\.toml: the metadata is not TOML"):
        read(tmp_path / "walk.csv")


@pytest.mark.parametrize(
    ("servo", "rule"),
    [
        ({"tibia": {}}, r"\[servo\.tibia\]: a servo table is named by the servo's ID"),
        ([1], "servo is no table"),
        ({"1": {"registers": 3}}, r"\[servo\.1\]: registers is no table"),
        (
            {"1": {"model": "XL-320", "registers": {"speed": 3}}},
            r"\[servo\.1\] registers\.speed: XL-320 has no such register",
        ),
        ({"1": {"model": "XL-320", "registers": {"p_gain": 256}}}, "more than its 1 byte"),
        ({"1": {"registers": {"p_gain": -1}}}, "is not a raw value"),
    ],
)
def test_servo_tables_that_cannot_be_read_are_refused(servo, rule):
    with pytest.raises(RecordingError, match=rule):
        Recording.checked(table(), {"format": FORMAT, "servo": servo})


FOREIGN = {"register": ["torque", "angle", "angle"], "raw": [-0.5, 1e9, 1.0]}


@pytest.mark.parametrize(
    "metadata",
    [{}, {"robot": "no-such-robot"}, {"servo": {"1": {"model": "MX-9"}, "2": {"model": "MX-9"}}}],
)
def test_registers_of_servos_of_unknown_model_are_not_checked(metadata):
    taken = Recording.checked(table(**FOREIGN), {"format": FORMAT} | metadata)
    assert taken.models == {}


def test_the_servo_table_names_the_model_before_the_robots_file_does():
    metadata = MARVIN | {"servo": {"1": {"model": "AX-12A"}, "2": {"registers": {"p_gain": 9}}}}
    taken = Recording.checked(table(), metadata)
    assert taken.models[1].model == "AX-12A"
    assert taken.models[2].model == "XL-320"
    with pytest.raises(RecordingError, match="servo 2 is XL-320"):
        Recording.checked(
            table(register=["a/b", "a/b", "cw_compliance_slope"], servo_id=[0, 0, 2]), metadata
        )


def test_a_model_without_a_table_is_not_taken_for_the_robots():
    taken = Recording.checked(
        table(**FOREIGN | {"servo_id": [1, 1, 1]}), MARVIN | {"servo": {"1": {"model": "MX-9"}}}
    )
    assert 1 not in taken.models


def test_a_robot_file_is_found_beside_the_recording(tmp_path):
    (tmp_path / "rig.toml").write_text(
        'format = "busemu-robot/1"\n[bus]\nprotocol = 2.0\nbaud_rate = 1000000\n'
        '[[servo]]\nid = 7\njoint = "arm"\nmodel = "XL-320"\n'
    )
    error = refused(
        tmp_path,
        {"servo_id": [7, 7, 7], "register": ["goal_position", "present_position", "angle"]},
        {"format": FORMAT, "robot": "rig.toml"},
    )
    assert error.row == 3


def test_lost_replies_are_no_reason_to_refuse():
    taken = Recording.checked(table(raw=[1.0, nan, nan], t_reply_s=[nan, nan, nan]), MARVIN)
    assert len(taken) == 3


def test_a_servo_with_id_0_shares_it_with_the_namespaces():
    columns = {"servo_id": [0, 0, 0], "register": ["goal_position", "imu/roll_rad", "goal"]}
    metadata = {"format": FORMAT, "servo": {"0": {"model": "XL-320"}}}
    with pytest.raises(RecordingError, match="row 3: unknown register: servo 0 is XL-320"):
        Recording.checked(table(raw=[1.0, -0.5, 1.0], **columns), metadata)


def test_equal_times_are_in_order():
    assert len(Recording.checked(table(t_s=[0.1, 0.1, 0.1]), MARVIN)) == 3
