"""A virtual line on a virtual clock: drives of several protocols, character times, echo, faults, power.

The owner of the line advances its time: a master in the same program by waiting (`VirtualPort`), a server by following
the real clock (`drivecomm.virtual.serving`).
"""

from __future__ import annotations

import heapq
from dataclasses import asdict
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any, Protocol as Interface, TypeAlias

from drivecomm.errors import UsageError, counted
from drivecomm.plant import UNDISTURBED
from drivecomm.protocol import LineSettings
from drivecomm.virtual.audience import Audience
from drivecomm.virtual.medium import MasterReceiver, Medium, Transmission
from drivecomm.virtual.port import VirtualPort
from drivecomm.virtual.station import PendingAnswer, Station, shared_settings, stations_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from drivecomm.plant import FaultPlan, PowerCut
    from drivecomm.protocol import VirtualDrive
    from drivecomm.virtual.medium import Source

_Event: TypeAlias = "tuple[float, int, Callable[[], None], float | Station]"
"""Time, order, action, and the seconds for which its effect stays unheard.

A station in place of the seconds is a drive that begins to answer.
"""

# Limit for late processing of transmissions by the drives. The master does not notice the delay: one character of an
# answer takes longer, or is as late as this.
_LATE_S = 0.0005


class Disturbance(Interface):
    """Changes to a transmission on its way, in addition to the line's `FaultPlan`."""

    def request(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        """Return the parts of a master's transmission that arrive, as delays and bytes."""
        ...

    def reply(self, data: bytes, drive: VirtualDrive, now: float) -> Sequence[tuple[float, bytes]]:
        """Return the parts of this drive's transmission that arrive, as delays and bytes."""
        ...


class VirtualLine:
    """A line with virtual drives. Its time passes only while its master waits, so tests take no time.

        line = VirtualLine([virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3)])
        with drivecomm.open_bus(line.port) as bus:
            ...

    Every drive hears everything on the line, with its own line settings, and ignores telegrams to others. Senders do
    not wait for each other: characters that are on the wire at the same time spoil each other for every receiver. A
    drive stores one answer: a request that it answers before it has begun an earlier answer replaces that answer.

    echo: the master hears itself, as with some two-wire adapters. faults: random faults on the way. paced: characters
    take their time; otherwise a transmission ends when it begins, and transmissions never collide.
    """

    def __init__(
        self,
        drives: Iterable[VirtualDrive] = (),
        *,
        echo: bool = False,
        faults: FaultPlan = UNDISTURBED,
        paced: bool = True,
    ) -> None:
        self.drives = list(drives)
        self.echo = echo
        self.faults = faults
        self.paced = paced
        self.disturbances: list[Disturbance] = []
        """Further faults, each applied to the result of the one before."""
        self.time = 0.0
        self.broken = False
        """Set to True to make the port fail as an unplugged adapter does."""
        self.monitors: list[Callable[[Transmission], None]] = []
        """Called with each transmission except echoes, when its last character has been sent."""
        self.recorders: list[Callable[[Transmission], None]] = []
        """Called like `monitors`, but perhaps late: a line that is served does not wake for them."""
        self.on_transmit: list[Callable[[Transmission], None]] = []
        """Called with each transmission when the master hands it over, before any fault applies."""
        self.told_settings: Mapping[str, Any] = {}
        """Line settings that a master with otherwise unknown settings has shown; checked, but not used for hearing."""
        self._stations = stations_of(self.drives)
        self._audience = Audience(self._stations)
        self._medium = Medium()
        self._events: list[_Event] = []
        self._order = 0
        self._free_at: dict[Station | Source, float] = {}
        self._port_free_at = 0.0
        self._wire = LineSettings()
        self._master = MasterReceiver({id(station.drive): station.agreed for station in self._stations})

    def __repr__(self) -> str:
        return f"<{type(self).__name__} with {counted(len(self.drives), 'drive')}, at {self.time:g} s>"

    def port(self) -> VirtualPort:
        """Open the master's end of the line."""
        return VirtualPort(self)

    def advance(self, seconds: float) -> None:
        """Let time pass without a transmission by the master."""
        self.pass_time(self.time + seconds)

    def pass_time(self, until: float) -> None:
        """Advance the clock to this time without a transmission by the master; ignore a time in the past."""
        while self._events and self._events[0][0] <= until:
            self._next()
        self.time = max(self.time, until)

    def call_at(self, time: float, action: Callable[[], None]) -> None:
        """Call an action at a time of the line's clock, perhaps during an exchange; immediately if the time is past."""
        self._call_at(time, action, 0.0)

    def _call_at(self, time: float, action: Callable[[], None], unheard: float | Station) -> None:
        self._order += 1
        heapq.heappush(self._events, (time, self._order, action, unheard))

    def configure(self, settings: LineSettings | None) -> None:
        """Set the master's line settings; None if they are unknown, as over plain TCP.

        A master with unknown settings counts as using the settings that each drive had when the line was made. Its
        characters take as long as those of the first drive.
        """
        self._master.listen(self.time)
        self._master.settings = settings
        self._wire = settings or (self._stations[0].agreed if self._stations else LineSettings())

    @property
    def backlog_s(self) -> float:
        """Seconds until all the master's data has been sent."""
        return max(0.0, self._port_free_at - self.time)

    @property
    def due(self) -> float:
        """Time of the next event, or of the next complete transmission at the master; infinite if there is none."""
        return min(self._events[0][0] if self._events else inf, self._master.due)

    @property
    def silent_until(self) -> float:
        """Time until which neither master nor monitor can notice whether due events have been processed.

        Each event takes effect at its own time of the line's clock, however late it is processed.
        """
        events, heard_at = self._events, self._master.due
        if not events:
            return heard_at
        time, _, _, unheard = events[0]
        if self.paced and not self.monitors:
            time += self._unheard_s(unheard) if isinstance(unheard, Station) else unheard
            # In a heap, the second earliest event is at index 1 or 2.
            for later in events[1:3]:
                time = min(time, later[0])
        return min(time, heard_at)

    def _unheard_s(self, station: Station) -> float:
        """Return the shortest time, in seconds, between waking a drive and its complete answer."""
        if station.answer is None or self.faults.rate or self.disturbances:
            return 0.0
        return self._wire_s(station.drive.settings, len(station.answer.data))

    def transmit(self, data: bytes) -> None:
        """Send bytes as the master."""
        # A port sends its characters in order, so data that is handed over early waits.
        began = max(self.time, self._port_free_at)
        self._port_free_at = began + self._wire_s(self._wire, len(data))
        if self.on_transmit and data:
            self._handed_over(data, began)
        if self.echo:
            self._speak_at(began, "echo", self.faults.echo(data))
        arrivals = self.faults.request(data)
        for disturbance in self.disturbances:
            arrivals = _then(arrivals, partial(disturbance.request, now=began))
        for delay, arriving in arrivals:
            self._speak_at(began + delay, "master", arriving)
        self._disturb(began)

    def _handed_over(self, data: bytes, began: float) -> None:
        sent = Transmission(
            source="master",
            sender=None,
            settings=self._wire,
            data=data,
            began=began,
            ended=self._port_free_at,
            agreed=self._master.settings is None,
            told_settings=self.told_settings if self._master.settings is None else asdict(self._wire),
            answer_due=self._medium.is_answered(self.time)
            or any(each.powered and each.answer is not None for each in self._stations),
        )
        for told in tuple(self.on_transmit):
            told(sent)

    def receive(self, until: float, at_least: int) -> bytes:
        """Return the bytes that the master has heard, once there are `at_least` of them, at the latest at `until`."""
        self._master.listen(self.time)
        while (missing := at_least - self._master.heard) > 0:
            ready = self._master.ready_at(missing)
            if self._events and self._events[0][0] <= min(ready, until):
                self._next()
            elif ready <= until:
                self.time = max(self.time, ready)
            else:
                self.time = max(self.time, until)
                break
            self._master.listen(self.time)
        return self.take()

    def take(self) -> bytes:
        """Return the bytes that the master has heard by now."""
        self._master.listen(self.time)
        return self._master.take()

    def inject(self, data: bytes) -> None:
        """Inject foreign bytes immediately: noise, or the traffic of another master."""
        self._speak("foreign", data)

    def power_off(self, drive: VirtualDrive) -> None:
        """Switch a drive off: it neither hears nor answers, and its present transmission breaks off."""
        station = self._station(drive)
        self._medium.cut_off(drive, self.time)
        self._free_at.pop(station, None)
        station.power_off(self.time)

    def power_on(self, drive: VirtualDrive, settings: LineSettings | None = None) -> None:
        """Switch a drive on again, with these line settings if given.

        It keeps its parameters. A virtual drive with a method `power_cycle(now)` resets its state in that method.
        """
        station = self._station(drive)
        if settings is not None:
            drive.settings = settings
        station.power_on(self.time)

    def has_power(self, drive: VirtualDrive) -> bool:
        """Whether a drive is switched on."""
        return self._station(drive).powered

    def _station(self, drive: VirtualDrive) -> Station:
        for station in self._stations:
            if station.drive is drive:
                return station
        raise UsageError(f"the drive at address {drive.address} is not on this virtual line")

    # Transmitting

    def _speak_at(self, time: float, who: Station | Source, data: bytes) -> None:
        if time > self.time:
            self.call_at(time, partial(self._speak, who, data))
        else:
            self._speak(who, data)

    def _speak(self, who: Station | Source, data: bytes) -> None:
        """Put characters on the wire, after any earlier ones of the same sender."""
        if (free_at := self._free_at.get(who, 0.0)) > self.time:
            self.call_at(free_at, partial(self._speak, who, data))
            return
        if not data:
            return
        source: Source = "drive" if isinstance(who, Station) else who
        sender = who.drive if isinstance(who, Station) else None
        settings = sender.settings if sender is not None else self._wire
        character_s = settings.character_s if self.paced else 0.0
        ended = self.time + len(data) * character_s
        agreed = sender is None and self._master.settings is None
        sent = Transmission(
            source=source, sender=sender, settings=settings, data=data, began=self.time, ended=ended, agreed=agreed
        )
        self._free_at[who] = ended
        self._medium.begin(sent)
        if isinstance(who, Station):
            who.spoke(ended)
        if source != "master":
            self._master.add(sent, self.time)
        if source != "echo":
            self._call_at(ended, partial(self._arrived, sent), min(_LATE_S, character_s))

    def _arrived(self, sent: Transmission) -> None:
        """Deliver a complete transmission to the drives."""
        for monitor in (*self.monitors, *self.recorders):
            monitor(sent)
        sound, settings = sent.sound(0, len(sent.data)), shared_settings(sent.settings)
        told = self._audience.of(sound, sent)
        for station in told:
            drive = station.drive
            if drive is not sent.sender and station.powered:
                spoken = station.agreed if sent.agreed else settings
                for answer in station.hear(station.received(sound, spoken), sent.began, sent.ended):
                    station.answering += 1
                    station.answer = PendingAnswer(sent.ended + answer.delay_s, answer.data, station.answering)
                    self._wake_to_answer(station, station.answer.time)
        self._audience.has_half_heard = any(station.pending for station in told)

    def _wake_to_answer(self, station: Station, time: float) -> None:
        """Schedule a drive's answer; one wake-up serves all answers that replace each other before it."""
        if time < station.wakes_at:
            station.wakes_at = time
            self._call_at(time, partial(self._visit, station, time), station)

    def _visit(self, station: Station, time: float) -> None:
        answer = station.answer
        if station.wakes_at != time or answer is None:
            return
        station.wakes_at = inf
        if answer.time > time:
            self._wake_to_answer(station, answer.time)
        else:
            station.answer = None
            self._answer(station, answer.data, answer.number)

    def _answer(self, station: Station, answer: bytes, number: int) -> None:
        """Send a drive's answer, unless it has lost power since.

        A drive also stays silent if the master is already sending again: it will answer the new request.
        """
        if station.answering != number or self._free_at.get("master", 0.0) > self.time:
            return
        arrivals = self.faults.reply(answer)
        for disturbance in self.disturbances:
            arrivals = _then(arrivals, partial(disturbance.reply, drive=station.drive, now=self.time))
        for delay, arriving in arrivals:
            self._speak_at(self.time + delay, station, arriving)
        self._disturb(self.time)
        if self.faults.rate and (cut := self.faults.power()) is not None:
            self._cut_power(station, cut, self._wire_s(station.drive.settings, len(answer)))

    def _disturb(self, began: float) -> None:
        if self.faults.rate:
            for delay, data in self.faults.foreign():
                self._speak_at(began + delay, "foreign", data)

    def _cut_power(self, station: Station, cut: PowerCut, reply_s: float) -> None:
        drive = station.drive
        off_at = self.time + cut.share * reply_s
        self.call_at(off_at, partial(self.power_off, drive))
        self.call_at(off_at + cut.lasts_s, partial(self.power_on, drive, cut.settings))
        if cut.settings is not None:
            station.right_settings = station.right_settings or drive.settings
            self.call_at(off_at + cut.lasts_s + cut.mismatch_s, station.set_right)

    def _next(self) -> None:
        time, _, action, _ = heapq.heappop(self._events)
        self.time = max(self.time, time)
        action()

    def _wire_s(self, settings: LineSettings, characters: int) -> float:
        return settings.wire_s(characters) if self.paced else 0.0


def _then(
    arrivals: Sequence[tuple[float, bytes]], disturb: Callable[[bytes], Sequence[tuple[float, bytes]]]
) -> list[tuple[float, bytes]]:
    """Apply a further disturbance to the arriving parts, and return the result."""
    return [(delay + more, left) for delay, data in arrivals for more, left in disturb(data)]
