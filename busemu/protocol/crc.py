"""The two check values: the 1.0 checksum and the 2.0 CRC.

Sources: e-manual dxl/protocol1 (Instruction Checksum) and dxl/crc. The CRC has polynomial 0x8005
(x^16 + x^15 + x^2 + 1), initial value 0, most significant bit first and no final inversion; it is
listed elsewhere as CRC-16/BUYPASS or CRC-16/UMTS, with the check value 0xFEE8 for "123456789".
`binascii.crc_hqx` is another one (polynomial 0x1021).
"""

from __future__ import annotations

from array import array
from struct import Struct

POLYNOMIAL = 0x8005


def checksum(data: bytes) -> int:
    """Return the Protocol 1.0 checksum of `data`, which runs from the ID to the last parameter."""
    return ~sum(data) & 0xFF


def _table_of_bytes() -> list[int]:
    """Return the CRC of each single byte: the remainder after its 8 bits went through."""
    table = []
    for byte in range(256):
        remainder = byte << 8
        for _ in range(8):
            remainder = remainder << 1 ^ (POLYNOMIAL if remainder & 0x8000 else 0)
        table.append(remainder & 0xFFFF)
    return table


_OF_BYTE = _table_of_bytes()
# The register is as wide as two bytes, so two bytes at a time is one look-up and no shift:
# half the steps of the usual loop for 65,536 entries and a few milliseconds at import. As an array
# they take 128 KiB, which stays in a cache; as a list of numbers over 2 MiB, which does not.
_OF_WORD = array(
    "H",
    (
        (first << 8 & 0xFF00) ^ _OF_BYTE[first >> 8 ^ low]
        for first in _OF_BYTE
        for low in range(256)
    ),
)
# By length of the data: a reader of it as two-byte numbers, without the first byte if that is odd.
_WORDS = [Struct(f">{'x' * (size & 1)}{size >> 1}H").unpack for size in range(64)]


def crc16(data: bytes, initial: int = 0) -> int:
    """Return the Protocol 2.0 CRC of `data`, going on from `initial` (the CRC of what came before).

    A packet's CRC covers everything before it, the header and the stuffing included.
    """
    crc = initial
    size = len(data)
    if size & 1:
        crc = (crc << 8 & 0xFF00) ^ _OF_BYTE[crc >> 8 ^ data[0]]
    table = _OF_WORD
    for word in _WORDS[size](data) if size < 64 else _words_of_long(data):
        crc = table[crc ^ word]
    return crc


def _words_of_long(data: bytes) -> tuple[int, ...]:
    size = len(data)
    return Struct(f">{'x' * (size & 1)}{size >> 1}H").unpack(data)
