"""From a stream of bytes, cut anywhere, to packets.

The framer holds at most one unfinished packet. It has no clock: the caller sees in `pending` that
a packet is unfinished and calls `abort` when the gap between two bytes has become too long
(100 ms in Protocol 1.0, 1.5 ms in 2.0).

**Where a packet begins.** At the first bytes that satisfy the whole of a rule below; everything
before them is noise. The rules are the regular expressions of `_WIRES`, one for a complete
beginning and one for a beginning that the end of the stream so far has cut off.

- 1.0: FF FF, an ID that is not FF, a length in 2..250. Of a longer run of FF the last two are the
  header and the others noise.
- 2.0: FF FF FD 00, an ID in 0..252 or 254, a length in 3..1024. A stuffed FF FF FD FD is no header,
  and neither is one with another reserved byte.

**Where it ends.** Where its length says, whatever the bytes between look like. A header inside a
2.0 packet does not cut it short: a CRC may happen to complete one, fast replies are not stuffed,
and some senders forget to stuff.

**After a wrong checksum or CRC.** The whole packet is reported once as a `BadPacket`. Its bytes are
then searched again from the second one on, because the length itself may have been damaged, or
bytes lost, and the next packet swallowed in part or whole. Such a second reading is trusted less:

- it needs an instruction the protocol defines (for a 1.0 status packet: bit 7 of the error clear),
  so that two FF among the parameters seldom keep the reader waiting for what is no packet;
- if its checksum is wrong too, it is dropped in silence: one broken packet, one report. Only bytes
  not yet reported as part of the bad packet come out as noise.

**Whole frames.** Most writes are one packet, and most packets have been there before: the same read
every cycle. What is exactly one sound frame, with nothing held from before, is looked up or parsed
without a search. The frames remembered are forgotten all at once when there are too many: to find
the oldest would cost every frame that is new more than it saves those that come again.

A servo that simply starts afresh after a bad packet does the same, except that it loses what the
bad packet had swallowed.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from busemu.protocol import v1, v2
from busemu.protocol.packets import BadPacket, Instruction, Noise, Packet

Role = Literal["device", "host"]


@dataclass(frozen=True, slots=True)
class _Wire:
    """What the framer must know of one wire format, as data.

    `complete` ends with the length, so its match ends where the body (instruction or error)
    begins; `length_before` reads the length there. What `parse` does not take, `refused` explains.
    """

    complete: re.Pattern[bytes]
    cut_off: re.Pattern[bytes]
    length_before: Callable[[bytes, int], int]
    credible: frozenset[int]
    parse: Callable[[bytes], Packet | None]
    refused: Callable[[bytes], BadPacket | None]


#: So many different frames are remembered, with what they say.
REMEMBERED = 1024


def _pattern(expression: bytes) -> re.Pattern[bytes]:
    return re.compile(expression, re.DOTALL | re.VERBOSE)


_COMPLETE_1 = _pattern(rb"\xff \xff [^\xff] [\x02-\xfa]")
_CUT_OFF_1 = _pattern(rb"\xff (?: \xff [^\xff]? )? \Z")
_COMPLETE_2 = _pattern(
    rb"\xff \xff \xfd \x00 [^\xfd\xff] (?: [\x03-\xff] \x00 | . [\x01-\x03] | \x00 \x04 )"
)
_CUT_OFF_2 = _pattern(rb"\xff (?: \xff (?: \xfd (?: \x00 (?: [^\xfd\xff] .? )? )? )? )? \Z")

_DEFINED_2 = frozenset(Instruction) - {Instruction.USB2AX_SYNC_READ}
_DEFINED_1 = frozenset(
    {
        Instruction.PING,
        Instruction.READ,
        Instruction.WRITE,
        Instruction.REG_WRITE,
        Instruction.ACTION,
        Instruction.FACTORY_RESET,
        Instruction.REBOOT,
        Instruction.SYNC_WRITE,
        Instruction.USB2AX_SYNC_READ,
        Instruction.BULK_READ,
    }
)


def _length_1(buffer: bytes, body: int) -> int:
    return buffer[body - 1]


def _length_2(buffer: bytes, body: int) -> int:
    return buffer[body - 2] | buffer[body - 1] << 8


def _wire_1(credible: frozenset[int], parse: Callable[[bytes], Packet | None]) -> _Wire:
    return _Wire(_COMPLETE_1, _CUT_OFF_1, _length_1, credible, parse, v1.refused)


_WIRE_2 = _Wire(_COMPLETE_2, _CUT_OFF_2, _length_2, _DEFINED_2, v2.parse, v2.refused)
_WIRES: dict[tuple[float, Role], _Wire] = {
    (1.0, "device"): _wire_1(_DEFINED_1, v1.parse_instruction),
    (1.0, "host"): _wire_1(frozenset(range(0x80)), v1.parse_status),
    (2.0, "device"): _WIRE_2,
    (2.0, "host"): _WIRE_2,
}


class Framer:
    """Cuts a stream of bytes into packets and noise; any bytes are input, none are an error.

    How the stream is divided over calls of `feed` does not change the packets or their order. It
    may change how noise is divided; between two packets its bytes are the same.

    In Protocol 1.0 the two kinds of packet look alike: for the role "device" every packet is an
    instruction packet, for "host" every one is a status packet. In 2.0 the packet tells itself.
    """

    __slots__ = ("_held", "_needed", "_reported", "_seen", "_wire")

    def __init__(self, protocol: float, *, role: Role = "device") -> None:
        """Take the protocol version, 1.0 or 2.0, and whose packets to expect."""
        try:
            self._wire = _WIRES[protocol, role]
        except KeyError:
            raise ValueError(f"no wire format for protocol {protocol!r}, role {role!r}") from None
        self._seen: dict[bytes, Packet] = {}
        self._held = b""
        self._needed = 0  # length of _held below which nothing can be decided
        self._reported = 0  # bytes at the start of _held that a BadPacket already reported

    @property
    def pending(self) -> int:
        """Bytes held that may still become a packet."""
        return len(self._held)

    def abort(self) -> Noise | None:
        """Drop what is held, as on a gap between bytes; return it unless all was reported."""
        rest = self._held[self._reported :]
        self._hold(b"", 0, 0)
        return Noise(rest) if rest else None

    def feed(self, data: bytes) -> list[Packet]:
        """Take the next bytes of the stream and return what they complete, in order."""
        packet = self.whole(data)
        return self._search(data) if packet is None else [packet]

    def whole(self, data: bytes) -> Packet | None:
        """The packet, if `data` is exactly one sound frame and nothing is held; it is then taken.

        Else `None`, and nothing is taken: `feed` it.
        """
        if self._held or type(data) is not bytes:
            return None
        seen = self._seen
        packet = seen.get(data)
        if packet is None:
            packet = self._wire.parse(data)
            if packet is not None:
                if len(seen) == REMEMBERED:
                    seen.clear()
                seen[data] = packet
        return packet

    def _search(self, data: bytes) -> list[Packet]:
        buffer = self._held + data
        if len(buffer) < self._needed:
            self._held = buffer
            return []
        wire = self._wire
        size = len(buffer)
        found: list[Packet] = []
        position = 0  # where the next packet may begin
        reported = self._reported  # all before this has been reported
        search = wire.complete.search
        while position < size:
            match = search(buffer, position)
            if match is None:
                cut_off = wire.cut_off.search(buffer, position)
                start = cut_off.start() if cut_off else size
                needed = size + 1
                break
            start, body = match.span()  # the pattern ends with the length
            end = body + wire.length_before(buffer, body)
            if start < reported:  # inside a bad packet
                if body >= size:
                    needed = body + 1
                    break
                if buffer[body] not in wire.credible:
                    position = start + 1
                    continue
            if end > size:
                needed = end
                break
            frame = buffer[start:end]
            packet = wire.parse(frame) or wire.refused(frame)
            bad = isinstance(packet, BadPacket)
            position = start + 1 if bad else end
            if packet is None or (bad and start < reported):
                continue
            if reported < start:
                found.append(Noise(buffer[reported:start]))
            found.append(packet)
            reported = max(reported, end)  # a sound packet within a bad one may end before it
        else:
            start = needed = size
        if reported < start:
            found.append(Noise(buffer[reported:start]))
            reported = start
        self._hold(buffer[start:], needed - start, reported - start)
        return found

    def _hold(self, held: bytes, needed: int, reported: int) -> None:
        self._held = held
        self._needed = needed
        self._reported = reported
