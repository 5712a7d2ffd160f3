"""What can go wrong between a host and its servos, as a small tree, in the e-manual's words.

::

    BusError
      PortError           the port cannot be opened; says what to do
      PortLostError       the port failed while in use (adapter unplugged)
      UnsendableError     the instruction packet cannot be sent correctly
      ReplyError          one servo's answer
        NoReplyError        no status packet before the timeout
        CorruptReplyError   a status packet with a wrong checksum, or cut short
        ServoError          the servo refused: error bits (1.0) or error number (2.0)
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

#: Protocol 1.0 error bits; source: ROBOTIS e-manual, "Protocol 1.0", status packet.
INPUT_VOLTAGE, ANGLE_LIMIT, OVERHEATING, RANGE = 0x01, 0x02, 0x04, 0x08
CHECKSUM, OVERLOAD, INSTRUCTION = 0x10, 0x20, 0x40
ERROR_BITS: Mapping[int, str] = MappingProxyType(
    {
        INPUT_VOLTAGE: "input voltage error",
        ANGLE_LIMIT: "angle limit error",
        OVERHEATING: "overheating error",
        RANGE: "range error",
        CHECKSUM: "checksum error",
        OVERLOAD: "overload error",
        INSTRUCTION: "instruction error",
    }
)
#: Bits that speak of the instruction just sent; the others speak of the servo's own state, and the
#: values in such a status packet are good. "Angle limit" is about the instruction only in a write.
REFUSAL_BITS = RANGE | CHECKSUM | INSTRUCTION

#: Protocol 2.0: bit 7 is the hardware alert, the rest an error number.
#: Source: ROBOTIS e-manual, "Protocol 2.0", status packet.
HARDWARE_ALERT = 0x80
ERROR_NUMBERS: Mapping[int, str] = MappingProxyType(
    {
        1: "result fail",
        2: "instruction error",
        3: "CRC error",
        4: "data range error",
        5: "data length error",
        6: "data limit error",
        7: "access error",
    }
)

#: Bits of ``hardware_error_status``; source: ROBOTIS e-manual, pages "XL-320" and "XL430-W250".
_XL320_STATUS = {0x01: "overload error", 0x02: "overheating error", 0x04: "input voltage error"}
_X_STATUS = {
    0x01: "input voltage error",
    0x04: "overheating error",
    0x08: "motor encoder error",
    0x10: "electrical shock error",
    0x20: "overload error",
}


def _join(bits: int, words: Mapping[int, str]) -> str:
    found = [word for bit, word in words.items() if bits & bit]
    return ", ".join(found) or f"unknown error 0x{bits:02X}"


def error_words(error: int, protocol: float) -> str:
    """Spell out the error field of a status packet in the e-manual's words."""
    if protocol == 1.0:
        return _join(error, ERROR_BITS)
    words = ["hardware alert"] if error & HARDWARE_ALERT else []
    number = error & ~HARDWARE_ALERT
    if number:
        words.append(ERROR_NUMBERS.get(number, f"unknown error number {number}"))
    return ", ".join(words)


def hardware_error_words(status: int, model: str) -> str:
    """Spell out ``hardware_error_status`` of a servo model; its bits differ between the series."""
    return _join(status, _XL320_STATUS if model == "XL-320" else _X_STATUS)


class BusError(Exception):
    """Anything between the host and its servos."""


class PortError(BusError):
    """The port cannot be opened: one line with the cause and what to do."""


class PortLostError(BusError):
    """The port failed while in use, as when its adapter is unplugged."""


class UnsendableError(BusError):
    """The instruction packet cannot be sent correctly; nothing was sent."""


class ReplyError(BusError):
    """One servo's answer did not come, came damaged, or was a refusal."""

    def __init__(self, servo_id: int, what: str) -> None:
        super().__init__(f"servo {servo_id}: {what}")
        self.servo_id = servo_id


class NoReplyError(ReplyError):
    """No status packet came before the SDK's timeout."""


class CorruptReplyError(ReplyError):
    """A status packet came with a wrong checksum, or without the bytes asked for."""


class ServoError(ReplyError):
    """The servo refused the instruction. ``error`` is the status packet's error field."""

    def __init__(self, servo_id: int, what: str, error: int, protocol: float) -> None:
        super().__init__(servo_id, f"{what}: {error_words(error, protocol)}")
        self.error = error
