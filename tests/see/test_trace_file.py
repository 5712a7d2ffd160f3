"""The trace: what is written is read back, within its size, whatever ends the writer."""

import os
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from busemu.assemble import assemble
from busemu.plant import ideal
from busemu.tables import load_robot
from busemu.timing import load_profile
from busemu.trace import WireEvent, WireEventKind
from busemu.traffic.explain import Tables
from busemu.traffic.follow import Follower, read_trace
from busemu.traffic.tally import Tally
from busemu.traffic.traceline import Dropped, Header, Record, TraceError, parse_line
from busemu.traffic.wirelog import HANDED_LIMIT_S, WAITING_LIMIT, WireLog

SMALL = 65536
HEADER = Header("marvin", 2.0, 1_000_000, "thesis-marvin", 5.0, 1.7e9)
READ = bytes.fromhex("FF FF FD 00 01 07 00 02 25 00 02 00 2D 95")

seconds = st.floats(0.0, 1e6).map(lambda value: round(value, 7))
records = st.builds(
    Record,
    st.builds(WireEvent, st.sampled_from(WireEventKind), seconds, seconds, st.binary(min_size=1)),
    st.none() | seconds,
    st.none() | seconds,
)


def event(start_s, kind=WireEventKind.INSTRUCTION, data=READ):
    return WireEvent(kind, start_s, start_s + 0.00014, data)


def write(log, count, start_s=10.0, data=READ):
    """So many instructions, 1 ms apart, each written as soon as it is told of."""
    for index in range(count):
        at_s = start_s + index * 1e-3
        log.heard(data, at_s)
        log.on_wire(event(at_s, data=data))
        log.flush(at_s)


@given(records)
def test_a_record_reads_back_as_it_was(record):
    again = parse_line(record.line())
    assert again.event.kind is record.event.kind
    assert again.event.data == record.event.data
    for name in ("read_s", "handed_s"):
        assert getattr(again, name) == pytest.approx(getattr(record, name), abs=1e-7)
    assert again.event.start_s == pytest.approx(record.event.start_s, abs=1e-7)


@given(st.text() | records.map(lambda record: record.line()[:-9]) | st.just("[1]") | st.just("3"))
def test_a_line_that_is_no_entry_is_no_error(line):
    assert parse_line(line) is None


@pytest.mark.parametrize("entry", [HEADER, Dropped(3)])
def test_other_lines_read_back_too(entry):
    assert parse_line(entry.line()) == entry


def test_a_bus_writes_each_run_of_bytes_with_modelled_and_measured_times(tmp_path):
    robot = load_robot("marvin")
    log = WireLog(tmp_path / "t", HEADER, SMALL)
    bus = assemble(robot, ideal(robot), load_profile("thesis-marvin"), on_wire=log.on_wire)
    log.heard(READ, 0.001)
    bus.receive(READ, 0.001)
    while not (reply := bus.poll(bus.next_deadline_s())):
        pass
    log.handed(reply, 0.005)
    log.flush(0.005)
    header, question, answer = read_trace(tmp_path / "t")
    assert header == HEADER
    assert (question.event.kind, question.event.data) == (WireEventKind.INSTRUCTION, READ)
    assert (question.read_s, question.handed_s) == (0.001, None)
    assert question.event.end_s - question.event.start_s == pytest.approx(140e-6, abs=1e-7)
    assert (answer.event.kind, answer.event.data) == (WireEventKind.STATUS, reply)
    assert (answer.read_s, answer.handed_s) == (None, 0.005)


def test_a_reply_waits_for_the_time_it_was_handed_over_but_not_for_ever(tmp_path):
    log = WireLog(tmp_path / "t", HEADER, SMALL)
    log.on_wire(event(10.0, WireEventKind.STATUS, b"abc"))
    log.on_wire(event(10.1, WireEventKind.STATUS, b"def"))
    log.flush(10.2)
    assert len(log) == 2
    log.handed(b"de", 10.2)
    log.handed(b"f", 10.3)  # the first is lost; in two portions
    log.flush(10.3)
    assert len(log) == 0
    _, first, second = read_trace(tmp_path / "t")
    assert (first.handed_s, second.handed_s) == (None, 10.3)
    log.on_wire(event(11.0, WireEventKind.STATUS, b"abc"))
    log.flush(11.0 + HANDED_LIMIT_S + 0.1)
    assert len(log) == 0


def test_one_flush_writes_a_few_lines_so_that_it_is_quick(tmp_path):
    log = WireLog(tmp_path / "t", HEADER, SMALL)
    for index in range(100):
        log.on_wire(event(index))
    log.flush(100.0)
    assert len(log) == 84


def test_file_and_older_half_stay_within_the_size_and_lose_nothing_between(tmp_path):
    path, older = tmp_path / "t", tmp_path / "t.1"
    log = WireLog(path, HEADER, SMALL)
    write(log, 2000)
    log.close()
    assert path.stat().st_size + older.stat().st_size <= SMALL
    assert sorted(each.name for each in tmp_path.iterdir()) == ["t", "t.1"]
    entries = [*read_trace(older), *read_trace(path)]
    assert entries.count(HEADER) == 2
    starts = [entry.event.start_s for entry in entries if isinstance(entry, Record)]
    assert starts == pytest.approx([11.999 - i * 1e-3 for i in range(len(starts))][::-1], abs=1e-6)
    assert len(starts) > 200


def test_what_cannot_be_written_in_time_is_counted(tmp_path):
    log = WireLog(tmp_path / "t", HEADER, SMALL)
    for index in range(WAITING_LIMIT + 7):
        log.on_wire(event(index))
    log.flush(1e9)
    assert list(read_trace(tmp_path / "t"))[1] == Dropped(7)


def test_a_server_that_starts_again_goes_on_behind_a_line_that_was_cut(tmp_path):
    path = tmp_path / "t"
    log = WireLog(path, HEADER, SMALL)
    write(log, 3)
    log.close()
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - 20)
    log = WireLog(path, HEADER, SMALL)
    write(log, 2)
    log.close()
    kinds = [type(entry) for entry in read_trace(path)]
    assert kinds == [Header, Record, Record, type(None), Header, Record, Record]


@pytest.mark.parametrize("name", ["t", "t.1"])
def test_a_file_that_is_no_trace_is_left_alone(tmp_path, name):
    (tmp_path / name).write_text("my thesis\n")
    with pytest.raises(TraceError, match=f"{name}: a file of that name is no trace"):
        WireLog(tmp_path / "t", HEADER, SMALL)
    assert (tmp_path / name).read_text() == "my thesis\n"


def test_a_trace_that_a_server_is_writing_is_left_alone(tmp_path):
    log = WireLog(tmp_path / "t", HEADER, SMALL)
    with pytest.raises(TraceError, match="another server is writing it"):
        WireLog(tmp_path / "t", HEADER, SMALL)
    log.close()
    WireLog(tmp_path / "t", HEADER, SMALL).close()


@pytest.mark.parametrize("path", ["/nowhere/t", "/dev/null", "/tmp"])
def test_a_path_that_cannot_be_written_is_one_clear_line(path):
    with pytest.raises(TraceError, match=f"--trace {path}: "):
        WireLog(Path(path), HEADER, SMALL)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
def test_a_full_disk_is_told_and_is_no_crash(tmp_path):
    log = WireLog(tmp_path / "t", HEADER, SMALL)
    log._file = os.open("/dev/full", os.O_WRONLY)
    log.on_wire(event(1.0))
    with pytest.raises(TraceError, match="No space left"):
        log.flush(2.0)


@pytest.fixture
def following():
    """Makes followers that are closed in the end."""
    followers = []

    def make(*arguments, **options):
        followers.append(Follower(*arguments, **options))
        return followers[-1]

    yield make
    for follower in followers:
        follower.close()


def follow(follower):
    entries = []
    while new := follower.poll():
        entries += new
    return entries


def test_a_follower_is_given_each_entry_once_over_rotation_and_restart(tmp_path, following):
    path = tmp_path / "t"
    follower = following(path)
    assert follower.poll() == []
    seen, told = [], 0
    for start in range(2):  # the second is a server that starts again
        log = WireLog(path, HEADER, SMALL)
        for turn in range(30):
            write(log, 40, start * 100.0 + turn)
            told += 40
            seen += follow(follower) + follow(follower)
        log.close()
    starts = [entry.event.start_s for entry in seen if isinstance(entry, Record)]
    assert len(starts) == told
    assert starts == sorted(starts)
    assert follower.damaged == 0


def test_a_follower_gives_no_line_before_it_is_whole(tmp_path, following):
    path = tmp_path / "t"
    line = Record(event(1.0), 1.0).line().encode()
    path.write_bytes(HEADER.line().encode() + line[:30])
    follower = following(path)
    assert follow(follower) == [HEADER]
    with path.open("ab") as file:
        file.write(line[30:] + line)
    assert [entry.event.start_s for entry in follow(follower)] == [1.0, 1.0]


def test_a_follower_goes_on_with_a_file_that_was_emptied(tmp_path, following):
    path = tmp_path / "t"
    log = WireLog(path, HEADER, SMALL)
    write(log, 5)
    follower = following(path)
    assert len(follow(follower)) == 6
    path.write_bytes(HEADER.line().encode())
    assert follow(follower) == [HEADER]
    log.close()


def test_a_follower_that_slept_goes_on_with_a_file_that_has_become_longer(tmp_path, following):
    path = tmp_path / "t"
    log = WireLog(path, HEADER, SMALL)
    write(log, 5)
    follower = following(path)
    follow(follower)
    write(log, 2, 20.0)
    path.rename(tmp_path / "t.1")
    log = WireLog(path, HEADER, SMALL)
    write(log, 50, 30.0)
    starts = [entry.event.start_s for entry in follow(follower) if isinstance(entry, Record)]
    assert starts[:3] == [20.0, 20.001, 30.0]
    assert len(starts) == 52


def test_an_unfinished_last_line_is_passed_over(tmp_path):
    line = Record(event(1.0), 1.0).line()
    (tmp_path / "t").write_text(HEADER.line() + line + line[:40])
    assert len(list(read_trace(tmp_path / "t"))) == 2


def test_an_account_goes_on_in_the_next_file_and_begins_anew_with_the_next_server():
    tally = Tally(lambda robot: Tables())
    record = Record(event(6.0), 6.0)
    for entry in (HEADER, record, HEADER, record):
        tally.take(entry)
    assert (tally.starts, tally.instructions["read"]) == (1, 2)
    for entry in (replace(HEADER, clock_s=50.0), record):
        tally.take(entry)
    assert (tally.starts, tally.instructions["read"]) == (2, 1)


def test_a_follower_may_begin_near_the_end_with_the_header_that_holds_there(tmp_path, following):
    path = tmp_path / "t"
    log = WireLog(path, HEADER, 10 * SMALL)
    write(log, 500)
    log.close()
    again = Header("phantomx", 1.0, 1_000_000, "ideal", 6.0, 1.7e9)
    log = WireLog(path, again, 10 * SMALL)
    write(log, 500)
    log.close()
    entries = follow(following(path, tail_bytes=5000))
    assert entries[0] == again
    assert 10 < len(entries) < 50


@pytest.mark.parametrize("content", ["", "nothing\n"])
def test_a_follower_of_another_file_says_so_or_waits(tmp_path, following, content):
    path = tmp_path / "t"
    path.write_text(content)
    if content:
        with pytest.raises(TraceError, match="no trace"):
            following(path).poll()
    else:
        assert following(path).poll() == []
