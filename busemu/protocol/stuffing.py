"""Byte stuffing of Protocol 2.0: what keeps a header from appearing inside a packet.

Source: e-manual dxl/protocol2, Packet Process. The rule covers the body of a packet, from the
instruction to the last parameter: wherever FF FF FD stands there, one FD follows that is not part
of the message. Length and CRC are those of the stuffed body.

- The pattern may begin with the instruction byte, so the body is treated as a whole.
- The pattern may end the body; its FD is added there too, or the CRC could complete a header.
- It cannot begin before the body: the byte there is the high byte of a length, never FF.
- It cannot overlap itself, so plain replacement from left to right is exact.
"""

from __future__ import annotations

PATTERN = b"\xff\xff\xfd"
STUFFED = b"\xff\xff\xfd\xfd"


def stuff(body: bytes) -> bytes:
    """Return `body` (instruction to last parameter) as it goes on the wire."""
    return body.replace(PATTERN, STUFFED)


def unstuff(body: bytes) -> bytes:
    """Return what a `body` from the wire means.

    A pattern without its FD, which a sender that does not stuff can produce, is left as it is.
    """
    return body.replace(STUFFED, PATTERN)
