"""Why a check value is wrong: the mistakes that senders make, tried one after another.

A wrong CRC is usually not chance. Somebody swapped its bytes, forgot what it covers, or took
another CRC of the same width. Each of these gives a value of its own, so the value tells which.
"""

from __future__ import annotations

import binascii
from collections.abc import Iterator

from ...protocol import checksum, crc16, stuff, unstuff
from ...protocol.v2 import BEFORE_BODY

#: Longest packet [bytes] in which a single flipped bit is looked for: beyond, chance finds one.
FLIP_LIMIT = 64


def crc_fault(frame: bytes) -> str | None:
    """What is wrong with the CRC of a whole Protocol 2.0 frame; None if it is right."""
    content, actual = frame[:-2], int.from_bytes(frame[-2:], "little")
    expected = crc16(content)
    if actual == expected:
        return None
    text = f"CRC is {_wire(actual)}, these bytes give {_wire(expected)}"
    return _with_reason(text, _crc_stories(content, expected), actual)


def checksum_fault(frame: bytes) -> str | None:
    """What is wrong with the checksum of a whole Protocol 1.0 frame; None if it is right."""
    expected, actual = checksum(frame[2:-1]), frame[-1]
    if actual == expected:
        return None
    text = f"checksum is {actual:02X}, these bytes give {expected:02X}"
    return _with_reason(text, _checksum_stories(frame), actual)


def _with_reason(text: str, stories: Iterator[tuple[int, str]], actual: int) -> str:
    for value, story in stories:
        if value == actual:
            return f"{text}: {story}"
    return text


def _crc_stories(content: bytes, expected: int) -> Iterator[tuple[int, str]]:
    """Each wrong value that a known mistake gives, and the mistake."""
    head, body = content[:BEFORE_BODY], content[BEFORE_BODY:]
    yield _swapped(expected), "its two bytes are swapped, the low one comes first"
    plain, stuffed = unstuff(body), stuff(body)
    if plain != body:
        for before in (head, _with_length(head, len(plain) + 2)):
            yield (
                crc16(before + plain),
                "it is right without the stuffing; the CRC has to cover the stuffed bytes",
            )
    if stuffed != body:
        for before in (head, _with_length(head, len(stuffed) + 2)):
            yield (
                crc16(before + stuffed),
                "it is right for the stuffed packet, but the packet was sent unstuffed",
            )
    yield crc16(content[4:]), "it leaves out the header, which the CRC covers too"
    yield crc16(content, 0xFFFF), "it was begun with FFFF instead of 0"
    for initial in (0xFFFF, 0):
        reflected = _reflected_crc16(content, initial)
        for value in (reflected, _swapped(reflected)):
            yield value, "it is the CRC of Modbus or ARC: the polynomial 8005 with bits reflected"
    for initial in (0xFFFF, 0):
        value = binascii.crc_hqx(content, initial)
        for either in (value, _swapped(value)):
            yield either, "it is the CCITT's CRC: polynomial 1021 instead of 8005"
    yield 0, "it was never filled in"
    if len(content) <= FLIP_LIMIT:
        yield from _flips(content, expected)


def _flips(content: bytes, expected: int) -> Iterator[tuple[int, str]]:
    """The value for each single bit of the packet that may have been flipped on its way."""
    for bit in range(16):
        yield expected ^ 1 << bit, f"a flipped bit {bit % 8} in the CRC itself would explain it"
    for index in range(len(content)):
        after = bytes(len(content) - 1 - index)
        for bit in range(8):
            yield (
                expected ^ crc16(bytes((1 << bit,)) + after),
                f"a flipped bit would explain it: byte {index} was {content[index] ^ 1 << bit:02X}",
            )


def _checksum_stories(frame: bytes) -> Iterator[tuple[int, str]]:
    body = frame[2:-1]
    yield sum(body) & 0xFF, "it is the sum, not inverted"
    yield -sum(body) & 0xFF, "it is the sum's two's complement; only invert it"
    yield checksum(frame[:-1]), "it counts the two header bytes, which are left out"
    yield checksum(body[1:]), "it leaves out the ID"
    yield checksum(body[:1] + body[2:]), "it leaves out the length"
    exclusive = 0
    for byte in body:
        exclusive ^= byte
    yield exclusive, "it is the exclusive or of the bytes, not their sum inverted"
    yield 0, "it was never filled in"


def _reflected_crc16(data: bytes, initial: int) -> int:
    crc = initial
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def _with_length(head: bytes, length: int) -> bytes:
    return head[:5] + (length & 0xFFFF).to_bytes(2, "little")


def _swapped(value: int) -> int:
    return (value & 0xFF) << 8 | value >> 8


def _wire(value: int) -> str:
    return value.to_bytes(2, "little").hex(" ").upper()
