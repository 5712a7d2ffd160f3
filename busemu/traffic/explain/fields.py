"""The fields that every packet has, and how fields lie on the wire."""

from __future__ import annotations

from collections.abc import Sequence

from ...protocol import ALERT_BIT, BROADCAST_ID, Error2, ErrorBit1
from ...protocol.stuffing import STUFFED
from .parameters import Field
from .split import Stretch


def error_words(error: int, protocol: float) -> str:
    """An error byte in the e-manual's words."""
    if error == 0:
        return "none"
    if protocol == 1.0:
        names = [bit.name or "" for bit in ErrorBit1 if error & bit]
        names += ["bit 7, which has no meaning"] if error & 0x80 else []
        return " and ".join(name.lower().replace("_", " ") for name in names) + " error"
    number = error & ~ALERT_BIT
    known = number in Error2.__members__.values()
    words = Error2(number).name.lower().replace("_", " ") if known else f"number {number}"
    parts = [words if words == "result fail" else f"{words} error"] if number else []
    return " and ".join([*parts, *(["alert (see hardware_error_status)"] if error & 0x80 else [])])


def head(stretch: Stretch) -> list[Field]:
    """The fields before the body, as far as they are there."""
    data, wrong = stretch.data, stretch.wrong
    if stretch.protocol == 1.0:
        cuts = [(0, 2, "header", ""), (2, 3, f"{_whose(data[2:3])}", "id")]
        length = data[3] if len(data) > 3 else 0
        cuts.append((3, 4, f"length {length}: from here to the checksum", "length"))
    else:
        length = int.from_bytes(data[5:7], "little")
        cuts = [
            (0, 3, "header", ""),
            (3, 4, "reserved", "reserved"),
            (4, 5, f"{_whose(data[4:5])}", "id"),
            (5, 7, f"length {length}: from here to the CRC", "length"),
        ]
    return [
        Field(data[start:end], words, name in wrong)
        for start, end, words, name in cuts
        if data[start:end]
    ]


def check_field(stretch: Stretch) -> Field:
    """The checksum or CRC at the end, and whether it is right."""
    size, name = (1, "checksum") if stretch.protocol == 1.0 else (2, "CRC")
    wrong = "check" in stretch.wrong
    doubtful = "length" in stretch.wrong
    words = "wrong" if wrong else "right, but for the length" if doubtful else "right"
    return Field(stretch.data[-size:], f"{name}: {words}", wrong)


def on_wire(fields: Sequence[Field], wire: bytes) -> list[Field]:
    """The fields of a body with the bytes that stuffing put among them."""
    spread, at = [], 0
    for field in fields:
        start = at
        for _ in field.data:
            at += 1
            if wire[max(0, at - 3) : at + 1] == STUFFED:
                at += 1
        piece = wire[start:at]
        stuffed = " (with a stuffing FD)" if len(piece) > len(field.data) else ""
        spread.append(Field(piece, field.words + stuffed, field.wrong))
    return spread


def _whose(data: bytes) -> str:
    if not data:
        return ""
    return "ID 254: broadcast" if data[0] == BROADCAST_ID else f"ID {data[0]}"
