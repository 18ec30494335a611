"""A virtual line on a virtual clock: several drives of several protocols, character times, echo, faults."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import LinkDownError
from drivecomm.line import LineSettings
from drivecomm.virtual.faults import UNDISTURBED
from drivecomm.virtual.station import Station
from drivecomm.virtual.uart import heard

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.protocol import VirtualDrive
    from drivecomm.virtual.faults import FaultPlan


@dataclass(frozen=True, slots=True)
class Transmission:
    """Some characters on the line; sender is None for the master."""

    began: float
    ended: float
    data: bytes
    settings: LineSettings
    sender: Station | None
    to_master: bool
    to_drives: bool


class VirtualLine:
    """A line with virtual drives on it. Its time passes only while its master waits, so tests take no time.

        line = VirtualLine([virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3)])
        with drivecomm.open_bus(line.port) as bus:
            ...

    Every drive hears everything on the line, with its own line settings, and ignores what is not for it. echo: the
    master hears itself, as on some two-wire adapters. faults: what goes wrong on the way.
    """

    def __init__(
        self, drives: Iterable[VirtualDrive] = (), *, echo: bool = False, faults: FaultPlan = UNDISTURBED
    ) -> None:
        self.drives = list(drives)
        self.echo = echo
        self.faults = faults
        self.time = 0.0
        self.broken = False
        """Set it to make the port fail as an unplugged adapter does."""
        self._stations = [Station(drive) for drive in self.drives]
        self._transmissions: list[tuple[float, int, Transmission]] = []
        self._order = 0
        self._busy_until = 0.0
        self._master = LineSettings()
        self._inbox = bytearray()

    def port(self) -> VirtualPort:
        """Open the master's end of the line."""
        return VirtualPort(self)

    def advance(self, seconds: float) -> None:
        """Let time pass without anybody speaking."""
        self._pass_time(self.time + seconds)

    def configure(self, settings: LineSettings) -> None:
        """Set the master's line settings."""
        self._master = settings

    def transmit(self, data: bytes) -> None:
        """Let the master send."""
        # A port sends one character after the other: what is handed over early waits its turn.
        began = max(self.time, self._busy_until)
        self._busy_until = began + self._master.wire_s(len(data))
        if self.echo:
            self._schedule(began, data, self._master, None, to_drives=False)
        free_at = began
        for delay, arriving in self.faults.request(data):
            start = max(began + delay, free_at)
            free_at = start + self._master.wire_s(len(arriving))
            self._schedule(start, arriving, self._master, None, to_master=False)

    def receive(self, until: float, at_least: int) -> bytes:
        """Return what the master has heard, as soon as it is this much, at the latest at `until`."""
        while len(self._inbox) < at_least and self._transmissions and self._transmissions[0][0] <= until:
            self._next()
        if len(self._inbox) < at_least:
            self._pass_time(until)
        data = bytes(self._inbox)
        self._inbox.clear()
        return data

    def inject(self, data: bytes) -> None:
        """Put bytes on the line that come from nobody, at once: noise, or foreign traffic."""
        self._schedule(self.time, data, self._master, None)

    def _pass_time(self, until: float) -> None:
        while self._transmissions and self._transmissions[0][0] <= until:
            self._next()
        self.time = max(self.time, until)

    def _schedule(
        self,
        began: float,
        data: bytes,
        settings: LineSettings,
        sender: Station | None,
        *,
        to_master: bool = True,
        to_drives: bool = True,
    ) -> None:
        # The first character and the rest arrive apart, so that a wait for the first one ends in time.
        for start, piece in ((began, data[:1]), (began + settings.character_s, data[1:])):
            if piece:
                ended = start + settings.wire_s(len(piece))
                sent = Transmission(start, ended, piece, settings, sender, to_master, to_drives)
                self._order += 1
                heapq.heappush(self._transmissions, (ended, self._order, sent))

    def _next(self) -> None:
        ended, _, sent = heapq.heappop(self._transmissions)
        self.time = max(self.time, ended)
        if sent.to_master:
            self._inbox += heard(sent.data, sent.settings, self._master)
        if not sent.to_drives:
            return
        for station in self._stations:
            if station is not sent.sender:
                arriving = heard(sent.data, sent.settings, station.drive.settings)
                for answer in station.hear(arriving, sent.began, ended):
                    for delay, reply in self.faults.reply(answer.data):
                        self._answer(ended + answer.delay_s + delay, reply, station)

    def _answer(self, began: float, reply: bytes, station: Station) -> None:
        # A repeated reply follows the first one on the wire.
        began = max(began, self._busy_until)
        self._busy_until = began + station.drive.settings.wire_s(len(reply))
        self._schedule(began, reply, station.drive.settings, station)


class VirtualPort:
    """The master's end of a virtual line."""

    paced = True
    real_time = False
    descriptor = None

    def __init__(self, line: VirtualLine) -> None:
        self._line = line
        self._check()

    def now(self) -> float:
        """Return the line's time."""
        return self._line.time

    def wall_time(self) -> float:
        """Return the line's time."""
        return self._line.time

    def configure(self, settings: LineSettings) -> str:
        """Set the master's line settings."""
        self._check()
        self._line.configure(settings)
        return ""

    def write(self, data: bytes) -> None:
        """Send."""
        self._check()
        self._line.transmit(data)

    def read(self, until: float, at_least: int) -> bytes:
        """Let time pass until this many bytes have come, or until then."""
        self._check()
        return self._line.receive(until, at_least)

    def take(self) -> bytes:
        """Return what has come by now."""
        return self.read(self._line.time, 1)

    def hold_back(self, at_least: int) -> None:
        """There is nobody to wake."""

    def wait(self, until: float) -> None:
        """Let time pass."""
        self._check()
        self._line.advance(max(0.0, until - self._line.time))

    def close(self) -> None:
        """Nothing to give back."""

    def _check(self) -> None:
        if self._line.broken:
            raise LinkDownError("the virtual line is broken; mend it by setting broken to False")
