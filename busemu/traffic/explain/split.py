"""Where packets begin and end in bytes that may be damaged, and what is wrong with each.

The bus's own reader (`busemu.protocol.Framer`) only has to get back to the next good packet. This
one has to say what went wrong, so it reads more than the servos would: it takes up a packet with a
false reserved byte, ID or length, and a packet that ends too early.

Every byte is part of exactly one stretch. A damaged packet ends where the next intact one begins,
where its length says, or where its check value says that it ended, whichever explains it best.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from ...protocol import checksum, crc16, stuff, unstuff, v1, v2
from .check import checksum_fault, crc_fault

#: A damaged packet is searched so far [bytes] for an end at which its CRC is right.
END_LIMIT = 64

_START_1 = re.compile(rb"\xff\xff(?!\xff)", re.DOTALL)
_START_2 = re.compile(rb"\xff\xff\xfd(?!\xfd)", re.DOTALL)
_HEADER_2 = re.compile(rb"\xff\xff\xfd\x00", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Stretch:
    """A run of bytes: a packet, intact or not, or noise (`protocol` is None).

    `whole` tells that there is a body with a check value behind it. `wrong` names the parts that
    the faults are about: reserved, id, length, body, check.
    """

    protocol: float | None
    data: bytes
    faults: tuple[str, ...] = ()
    wrong: frozenset[str] = frozenset()
    whole: bool = True


def split(data: bytes, protocol: float | None = None) -> list[Stretch]:
    """Divide `data` into packets and noise; protocol None: each packet tells by its header."""
    stretches: list[Stretch] = []
    position = 0
    has_2 = protocol != 1.0 and _HEADER_2.search(data) is not None
    while position < len(data):
        found = _next(data, position, protocol, has_2)
        start = len(data) if found is None else found[0]
        if start > position:
            stretches.append(_noise(data[position:start], before_header=found is not None))
        if found is None:
            break
        stretch = _read_1(data, start) if found[1] == 1.0 else _read_2(data, start)
        stretches.append(stretch)
        position = start + len(stretch.data)
    return stretches


def _noise(data: bytes, *, before_header: bool) -> Stretch:
    count = f"{len(data)} byte{'s' if len(data) > 1 else ''}"
    if b"\xff\xff\xfd\xfd" in data:
        story = "with a stuffed FF FF FD FD: the rest of a packet whose beginning is lost"
    elif any(_good_1(data, match.start()) for match in _START_1.finditer(data)):
        story = "a Protocol 1.0 packet is among them"
    elif not data.strip(b"\xff"):
        story = "nothing but FF: the line, or a header that does not go on"
    elif not data.strip(b"\x00"):
        story = "nothing but 00: a break, or a host at a lower baud rate"
    else:
        story = ""
    text = f"{count} {'before a header' if before_header else 'without a header'}"
    return Stretch(None, data, (text + (f"; {story}" if story else ""),), whole=False)


def _next(
    data: bytes, position: int, protocol: float | None, has_2: bool
) -> tuple[int, float] | None:
    """Where the next packet begins, and its protocol."""
    if protocol is not None:
        pattern = _START_1 if protocol == 1.0 else _START_2
        match = pattern.search(data, position)
        return None if match is None else (match.start(), protocol)
    for match in _START_1.finditer(data, position):
        start = match.start()
        if _HEADER_2.match(data, start):
            return start, 2.0
        if _good_1(data, start):
            return start, 1.0
        if _START_2.match(data, start) and (has_2 or _but_reserved(data, start)):
            return start, 2.0
        if not has_2:
            return start, 1.0
    return None


def _good_1(data: bytes, start: int) -> int | None:
    """Where the intact Protocol 1.0 packet at `start` ends."""
    if start + 6 > len(data) or not v1.MIN_LENGTH <= data[start + 3] <= v1.MAX_LENGTH:
        return None
    end = start + v1.BEFORE_BODY + data[start + 3]
    if end > len(data) or checksum(data[start + 2 : end - 1]) != data[end - 1]:
        return None
    return end


def _good_2(data: bytes, start: int) -> int | None:
    """Where the packet at `start` with a right Protocol 2.0 CRC ends."""
    if start + 10 > len(data):
        return None
    length = int.from_bytes(data[start + 5 : start + 7], "little")
    end = start + v2.BEFORE_BODY + length
    if not v2.MIN_LENGTH <= length <= v2.MAX_LENGTH or end > len(data):
        return None
    return end if _crc_fits(data[start:end]) else None


def _but_reserved(data: bytes, start: int) -> bool:
    """Whether a packet is intact but for its reserved byte, or for nothing at all."""
    frame = data[start : start + v2.BEFORE_BODY + v2.MAX_LENGTH]
    return bool(_good_2(frame, 0) or _good_2(v2.HEADER + frame[4:], 0))


def _crc_fits(frame: bytes) -> bool:
    return crc16(frame[:-2]) == int.from_bytes(frame[-2:], "little")


def _stop(data: bytes, start: int, protocol: float) -> int:
    """Where the next intact packet begins behind the damaged one at `start`, or the data ends."""
    longest = v1.BEFORE_BODY + v1.MAX_LENGTH if protocol == 1.0 else v2.BEFORE_BODY + v2.MAX_LENGTH
    limit = min(len(data), start + longest)
    for match in (_START_1 if protocol == 1.0 else _HEADER_2).finditer(data, start + 2, limit):
        if (_good_1 if protocol == 1.0 else _good_2)(data, match.start()):
            return match.start()
    return limit


def _read_1(data: bytes, start: int) -> Stretch:
    end = _good_1(data, start)
    if end is not None:
        return Stretch(1.0, data[start:end])
    stop = _stop(data, start, 1.0)
    rest = data[start:stop]
    if len(rest) < 6:
        says = rest[3] if len(rest) >= v1.BEFORE_BODY else 0
        return _cut_off(1.0, rest, v1.BEFORE_BODY + max(v1.MIN_LENGTH, says))
    length = rest[3]
    whole = v1.BEFORE_BODY + length
    sum_as_is = checksum(rest[2:-1])
    if len(rest) != whole and rest[-1] in (sum_as_is, sum_as_is + length - len(rest) + 4 & 0xFF):
        return _wrong_length(1.0, rest, length, len(rest) - v1.BEFORE_BODY, rest[-1] == sum_as_is)
    if not v1.MIN_LENGTH <= length <= v1.MAX_LENGTH:
        fault = f"length is {length}, but {v1.MIN_LENGTH} to {v1.MAX_LENGTH} is possible"
        if rest.startswith(v2.HEADER):
            fault += "; this is a Protocol 2.0 header"
        return Stretch(1.0, rest, (fault,), frozenset({"length"}), whole=False)
    if whole > len(rest):
        return _cut_off(1.0, rest, whole)
    fault = checksum_fault(rest[:whole]) or ""
    return Stretch(1.0, rest[:whole], (fault,), frozenset({"check"}))


def _read_2(data: bytes, start: int) -> Stretch:
    end = _good_2(data, start)
    if end is not None:
        return _with_form_faults(Stretch(2.0, data[start:end]))
    stop = _stop(data, start, 2.0)
    rest = data[start:stop]
    if len(rest) < 10:
        says = int.from_bytes(rest[5:7], "little") if len(rest) >= v2.BEFORE_BODY else 0
        sensible = v2.MIN_LENGTH <= says <= v2.MAX_LENGTH
        whole = v2.BEFORE_BODY + says if sensible else 10
        return _with_form_faults(_cut_off(2.0, rest, whole))
    length = int.from_bytes(rest[5:7], "little")
    whole = v2.BEFORE_BODY + length
    for size in range(10, min(len(rest), END_LIMIT) + 1):
        corrected = rest[:5] + (size - v2.BEFORE_BODY).to_bytes(2, "little") + rest[7:size]
        as_is = _crc_fits(rest[:size])
        if size != whole and (as_is or _crc_fits(corrected)):
            return _with_form_faults(
                _wrong_length(2.0, rest[:size], length, size - v2.BEFORE_BODY, as_is)
            )
    if not v2.MIN_LENGTH <= length <= v2.MAX_LENGTH:
        fault = f"length is {length}, but {v2.MIN_LENGTH} to {v2.MAX_LENGTH} is possible"
        return _with_form_faults(Stretch(2.0, rest, (fault,), frozenset({"length"}), whole=False))
    if whole > len(rest):
        return _with_form_faults(_cut_off(2.0, rest, whole))
    fault = crc_fault(rest[:whole]) or ""
    return _with_form_faults(Stretch(2.0, rest[:whole], (fault,), frozenset({"check"})))


def _cut_off(protocol: float, data: bytes, whole: int) -> Stretch:
    at_least = "at least " if len(data) < (4 if protocol == 1.0 else 7) else ""
    fault = f"cut off: {len(data)} bytes of {at_least}{whole} are there"
    return Stretch(protocol, data, (fault,), frozenset({"body"}), whole=False)


def _wrong_length(protocol: float, data: bytes, says: int, is_: int, as_is: bool) -> Stretch:
    check = "checksum" if protocol == 1.0 else "CRC"
    cause = ""
    if protocol == 2.0:
        body = data[7:-2]
        if len(unstuff(body)) + 2 == says != is_:
            cause = "; it does not count the stuffing"
        elif len(stuff(body)) + 2 == says != is_:
            cause = "; it counts stuffing that was not sent"
    sender = "as sent" if as_is else "with that length"
    fault = f"length is {says}, should be {is_}{cause} (the {check} is right {sender})"
    return Stretch(protocol, data, (fault,), frozenset({"length"}))


def _with_form_faults(stretch: Stretch) -> Stretch:
    """The same with what can be wrong in a Protocol 2.0 packet whatever its length and CRC."""
    data = stretch.data
    faults, wrong = list(stretch.faults), set(stretch.wrong)
    if len(data) > 3 and data[3] != 0:
        faults.append(f"reserved byte is {data[3]:02X}, must be 00")
        wrong.add("reserved")
    if len(data) > 4 and data[4] in (0xFD, 0xFF):
        faults.append(f"ID is {data[4]}, but 0 to {v2.MAX_ID} or 254 is possible")
        wrong.add("id")
    if stretch.whole and _unstuffed(data):
        faults.append(
            "not stuffed: FF FF FD among the parameters has no FD behind it "
            "(the official Python SDK 4.1.0 forgets it)"
        )
        wrong.add("body")
    return Stretch(2.0, data, tuple(faults), frozenset(wrong), stretch.whole)


def _unstuffed(frame: bytes) -> bool:
    fast_reply = frame[4] == 0xFE and frame[7] == v2.STATUS  # not stuffed, by definition
    body = frame[7:-2]
    return not fast_reply and stuff(unstuff(body)) != body
