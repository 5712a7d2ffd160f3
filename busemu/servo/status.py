"""Why a servo refuses, and how each protocol says so in the error byte of a status packet."""

from __future__ import annotations

import enum
from types import MappingProxyType

from ..protocol import ALERT_BIT, Error2, ErrorBit1


class Refusal(enum.Enum):
    """What was wrong with an instruction."""

    INSTRUCTION = "undefined instruction, or action without a registered write"
    CHECKSUM = "checksum or CRC does not match"
    RANGE = "value outside the register's range"
    LENGTH = "too few or too many bytes"
    LIMIT = "goal outside the limits set"
    ACCESS = "read-only, locked, or no such address"
    RESULT = "could not be carried out"


class Alarm(enum.Flag):
    """Conditions a servo watches; the same for every model, coded differently by each."""

    NONE = 0
    VOLTAGE = enum.auto()
    OVERHEATING = enum.auto()
    OVERLOAD = enum.auto()
    ENCODER = enum.auto()
    ELECTRICAL_SHOCK = enum.auto()


_V1 = MappingProxyType(
    {
        Refusal.INSTRUCTION: ErrorBit1.INSTRUCTION,
        Refusal.CHECKSUM: ErrorBit1.CHECKSUM,
        Refusal.RANGE: ErrorBit1.RANGE,
        Refusal.LENGTH: ErrorBit1.INSTRUCTION,
        Refusal.LIMIT: ErrorBit1.ANGLE_LIMIT,
        Refusal.ACCESS: ErrorBit1.RANGE,
        Refusal.RESULT: ErrorBit1.INSTRUCTION,
    }
)
_V2 = MappingProxyType(
    {
        Refusal.INSTRUCTION: Error2.INSTRUCTION,
        Refusal.CHECKSUM: Error2.CRC,
        Refusal.RANGE: Error2.DATA_RANGE,
        Refusal.LENGTH: Error2.DATA_LENGTH,
        Refusal.LIMIT: Error2.DATA_LIMIT,
        Refusal.ACCESS: Error2.ACCESS,
        Refusal.RESULT: Error2.RESULT_FAIL,
    }
)
#: Bits of ``shutdown`` and ``alarm_led`` of Protocol 1.0 models: those of the error byte.
ALARM_BITS_V1 = MappingProxyType(
    {
        Alarm.VOLTAGE: int(ErrorBit1.INPUT_VOLTAGE),
        Alarm.OVERHEATING: int(ErrorBit1.OVERHEATING),
        Alarm.OVERLOAD: int(ErrorBit1.OVERLOAD),
    }
)
#: Names of the alarms in ``drive.shutdown_bits`` of a table.
ALARM_NAMES = MappingProxyType(
    {
        "input_voltage": Alarm.VOLTAGE,
        "overheating": Alarm.OVERHEATING,
        "overload": Alarm.OVERLOAD,
        "encoder": Alarm.ENCODER,
        "electrical_shock": Alarm.ELECTRICAL_SHOCK,
    }
)


def error_byte(protocol: float, refusal: Refusal | None, alarms: Alarm) -> int:
    """The error byte of a status packet.

    Protocol 1.0 sets a bit for the refusal and one for each alarm; Protocol 2.0 gives the refusal's
    number, with the alert bit where the servo holds a hardware error.
    """
    if protocol == 1.0:
        bits = 0 if refusal is None else int(_V1[refusal])
        for alarm, bit in ALARM_BITS_V1.items():
            if alarm in alarms:
                bits |= bit
        return bits
    return (0 if refusal is None else int(_V2[refusal])) | (ALERT_BIT if alarms else 0)
