"""The two check values: the 1.0 checksum and the 2.0 CRC.

Sources: e-manual dxl/protocol1 (Instruction Checksum) and dxl/crc. The CRC has polynomial 0x8005
(x^16 + x^15 + x^2 + 1), initial value 0, most significant bit first and no final inversion; it is
listed elsewhere as CRC-16/BUYPASS or CRC-16/UMTS, with the check value 0xFEE8 for "123456789".
It is computed by fastcrc, in compiled code: nothing in the standard library can (`binascii.crc_hqx`
has polynomial 0x1021), and in Python it is half of what a packet costs.
"""

from __future__ import annotations

from fastcrc.crc16 import umts


def checksum(data: bytes) -> int:
    """Return the Protocol 1.0 checksum of `data`, which runs from the ID to the last parameter."""
    return ~sum(data) & 0xFF


crc16 = umts
"""The Protocol 2.0 CRC of ``data``, going on from ``initial``, the CRC of what came before, or 0.

A packet's CRC covers everything before it, the header and the stuffing included.
"""
