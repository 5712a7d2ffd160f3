"""The two Dynamixel wire formats, as pure functions and one reader.

Sources: ROBOTIS e-manual, pages dxl/protocol1, dxl/protocol2 and dxl/crc. Nothing here does I/O,
reads a clock or draws a random number: bytes go in, packets come out, and the other way round.

**One wire, two kinds of packet.** All servos and the host share one half-duplex line, eight data
bits, no parity, one stop bit. The host sends an *instruction packet* that names a servo by its ID,
or all of them by the broadcast ID 254; the servo named sends a *status packet* back. Nobody else
speaks unasked, so the line needs no arbitration, only patience.

**Protocol 1.0** (AX, RX, EX, DX, MX as delivered)::

    FF FF | ID | LENGTH | INSTRUCTION or ERROR | parameters ... | CHECKSUM

Addresses and lengths are one byte. LENGTH is parameters + 2. The checksum is the inverted low byte
of the sum from the ID on. A status packet has the same shape with an error byte, a set of
`ErrorBit1` flags, where the instruction stood: only knowing who speaks tells the two apart, hence
the role of a `Framer`. Parameters are sent as they are, so FF FF among them looks like a header and
a reader that joins in the middle can be fooled until a checksum puts it right. A broadcast is never
answered.

**Protocol 2.0** (X, P, PRO, XL-320, MX with later firmware)::

    FF FF FD 00 | ID | LENGTH low high | INSTRUCTION | parameters ... | CRC low high

Addresses and lengths are two bytes, low byte first. LENGTH is parameters + 3. A status packet says
so: its instruction is 55, and its error byte, a number of `Error2` with the `ALERT_BIT`, comes
before the parameters. *Stuffing* puts an FD after each FF FF FD from the instruction to the last
parameter, so a packet cannot contain a header; length and CRC count the stuffed bytes. A broadcast
is answered when it is a ping or a read that lists the servos, one after another.

**Fast reads** (2.0, later firmware) draw the answers of many servos together into one packet from
the broadcast ID, to which each servo adds its block; it is not stuffed. See `busemu.protocol.v2`.

**Reading.** `Framer` takes any bytes in any portions and gives packets, bad packets and noise; its
module says where a packet begins, where it ends, and how the reader recovers from a damaged one.

**Writing.** The encoders differ by protocol and are used by module: ``v1.encode_status(packet)``,
``v2.encode_status(packet)``.
"""

from busemu.protocol import v1, v2
from busemu.protocol.crc import checksum, crc16
from busemu.protocol.framer import Framer, Role
from busemu.protocol.packets import (
    ALERT_BIT,
    BROADCAST_ID,
    BadPacket,
    Error2,
    ErrorBit1,
    Instruction,
    InstructionPacket,
    Noise,
    Packet,
    StatusPacket,
)
from busemu.protocol.stuffing import stuff, unstuff
from busemu.protocol.v2 import encode_fast_status, fast_status_slices, split_fast_status

__all__ = [
    "ALERT_BIT",
    "BROADCAST_ID",
    "BadPacket",
    "Error2",
    "ErrorBit1",
    "Framer",
    "Instruction",
    "InstructionPacket",
    "Noise",
    "Packet",
    "Role",
    "StatusPacket",
    "checksum",
    "crc16",
    "encode_fast_status",
    "fast_status_slices",
    "split_fast_status",
    "stuff",
    "unstuff",
    "v1",
    "v2",
]
