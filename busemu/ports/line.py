"""A bus whose wire is real: this program is the servos on the UART of a real control board.

On a pseudo-terminal the wire is modelled, and so are the USB and the adapter of the client. Here
they exist and take their own time; charging them again would count them twice. What is left to the
model is what the *servos* would do: the turnaround, the return delay, the motor interrupt, and the
order of chained replies. So

* bytes that have come are over on the wire already: the bus is told that they ended just now, and
  began when the reply before them was over at the earliest, since the board has waited for it;
* a reply is given to the UART when its first bit is due, not when its last one would have arrived;
* the servo after it in a chain has its turn when the UART is done with the reply, as the baud rate
  says.

An adapter hands bytes up in portions, with pauses that were not on the wire. Packets are put
together here before the bus, which takes a long pause for the end of a packet, sees them. An
adapter that hears itself gives every reply back; such an echo is dropped.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from ..bus import Bus
from ..protocol import Framer
from ..timing import INTERBYTE_TIMEOUT_S, Profile
from ..trace import BusCounts, WireEvent, WireEventKind

#: So much longer than on the wire a pause within a packet may be, for the adapter's sake [s]: the
#: latency timer of an FTDI adapter is 16 ms, and a USB frame 1 ms. Source: FTDI AN232B-04.
ADAPTER_S = 0.017


def servo_side(profile: Profile) -> Profile:
    """The profile without the parts that a real line brings along: host, USB, adapter, kernel."""
    return replace(
        profile,
        name=f"{profile.name} (servos only)",
        host_out_s=0.0,
        host_in_s=0.0,
        usb_frame_s=0.0,
        adapter_out_s=0.0,
        wake_s=0.0,
        latency_timer_s=0.0,
        chunk_bytes=0,
        echo=False,
    )


class UartLine:
    """``bus``, made with a :func:`servo_side` profile, for a port that is a real UART.

    It has the calls of a bus that the serving loop makes; times are in s of the bus's clock.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._framer = Framer(bus.protocol)
        self._gap_s = INTERBYTE_TIMEOUT_S[bus.protocol] + ADAPTER_S
        self._held = bytearray()  #: bytes that may still become a packet
        self._heard_s = 0.0  #: when the last of them came
        self._hearing = False
        self._due: deque[tuple[float, bytes]] = deque()  #: replies: first bit [s], bytes
        self._echoes: deque[bytes] = deque()  #: replies sent since the last instruction
        self._sent_until_s = 0.0  #: when the last of them is over on the wire
        self._listener = bus.on_wire
        bus.on_wire = self._note

    @property
    def baud_rate(self) -> int:
        """The baud rate of the UART [bit/s]."""
        return self._bus.baud_rate

    @baud_rate.setter
    def baud_rate(self, baud_rate: int) -> None:
        self._bus.baud_rate = baud_rate

    @property
    def counts(self) -> BusCounts:
        """What the bus has seen."""
        return self._bus.counts

    @property
    def plant_s(self) -> float:
        """The instant up to which the joints have been advanced [s]."""
        return self._bus.plant_s

    @property
    def line_free_s(self) -> float:
        """When the last byte of the board is over [s]: it is, once it has come."""
        return self._bus.line_free_s

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes that had come over the wire by ``now_s``."""
        if self._held and now_s - self._heard_s > self._gap_s:
            self._framer.abort()
            self._pass_on(len(self._held), self._heard_s)
        self._held += data
        self._heard_s = now_s
        self._framer.feed(data)
        self._pass_on(len(self._held) - self._framer.pending, now_s)

    def _pass_on(self, length: int, now_s: float) -> None:
        """Let the bus have the first ``length`` bytes held; the last of all has come now."""
        data = bytes(self._held[:length])
        del self._held[:length]
        data = self._without_echoes(data)
        if data:
            byte_s = self._bus.profile.byte_s(self._bus.baud_rate)
            self._hearing = True
            start_s = now_s - (len(data) + len(self._held)) * byte_s
            self._bus.receive(data, max(start_s, self._sent_until_s))
            self._hearing = False

    def _without_echoes(self, data: bytes) -> bytes:
        while self._echoes and data.startswith(self._echoes[0]):
            data = data[len(self._echoes.popleft()) :]
        if data:
            self._echoes.clear()
        return data

    def _note(self, event: WireEvent) -> None:
        """Take a reply from the bus's account of its wire; what was heard is there as well."""
        if self._listener is not None:
            self._listener(event)
        if self._hearing or event.kind not in (WireEventKind.STATUS, WireEventKind.COLLISION):
            return
        index = len(self._due)
        while index and self._due[index - 1][0] > event.start_s:
            index -= 1
        self._due.insert(index, (event.start_s, event.data))

    def next_reply_s(self) -> float | None:
        """When the next reply has to be given to the UART, as far as that is known [s]."""
        return self._due[0][0] if self._due else None

    def next_deadline_s(self) -> float:
        """When something happens next [s]."""
        bus_s = self._bus.next_deadline_s()
        return min(bus_s, self._due[0][0]) if self._due else bus_s

    def poll(self, now_s: float) -> bytes:
        """Let everything happen that is due by ``now_s``; the bytes to be sent by then."""
        self._bus.poll(now_s)  # what it has for a client's adapter is on a real line already
        return self.deliver(now_s)

    def deliver(self, now_s: float) -> bytes:
        """Only the bytes to be sent by ``now_s``, of what has already happened."""
        out = bytearray()
        while self._due and self._due[0][0] <= now_s:
            start_s, data = self._due.popleft()
            byte_s = self._bus.profile.byte_s(self._bus.baud_rate)
            self._sent_until_s = start_s + len(data) * byte_s
            self._echoes.append(data)
            out += data
        return bytes(out)

    def advance_plant(self, to_s: float) -> None:
        """Simulate the joints up to ``to_s`` [s]."""
        self._bus.advance_plant(to_s)
