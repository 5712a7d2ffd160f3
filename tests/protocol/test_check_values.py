"""The 1.0 checksum and the 2.0 CRC."""

from __future__ import annotations

import pypot.dynamixel.protocol.v2 as pypot2
from hypothesis import given
from hypothesis import strategies as st
from wire_oracles import SDK2

from busemu.protocol import checksum, crc16


def crc_bit_by_bit(data: bytes) -> int:
    """The definition: divide the message, then 16 zero bits, by x^16 + x^15 + x^2 + 1."""
    remainder = 0
    for bit in "".join(f"{byte:08b}" for byte in data) + 16 * "0":
        remainder = remainder << 1 | int(bit)
        if remainder & 0x10000:
            remainder ^= 0x18005
    return remainder


def test_the_crc_is_the_one_catalogued_as_buypass():
    assert crc16(b"123456789") == 0xFEE8
    assert crc16(b"") == 0


@given(st.binary(max_size=40))
def test_the_crc_is_the_remainder_of_the_division(data: bytes):
    assert crc16(data) == crc_bit_by_bit(data)


@given(st.binary(max_size=300))
def test_the_crc_is_that_of_the_sdk_and_of_pypot(data: bytes):
    assert crc16(data) == SDK2.updateCRC(0, data, len(data)) == pypot2.crc16(data, len(data))


@given(st.binary(max_size=60), st.binary(max_size=60))
def test_a_crc_can_be_continued(first: bytes, second: bytes):
    assert crc16(second, crc16(first)) == crc16(first + second)


@given(st.binary(max_size=300))
def test_the_checksum_and_the_sum_are_all_ones_in_the_low_byte(data: bytes):
    assert (sum(data) + checksum(data)) & 0xFF == 0xFF
