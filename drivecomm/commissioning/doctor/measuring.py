"""Measurement of an adapter and its line: noise, echo, drives that answer, reply times. `findings` judges the result.

It sends only a few bytes that no installed protocol takes for a telegram, and the probes of the protocols, which cannot
move a motor.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from drivecomm.bus import Found, open_bus, scan_plan
from drivecomm.commissioning.doctor.listening import IdleObservation, listen, settings_of
from drivecomm.commissioning.doctor.measurements import Measurements, Replies, SearchedDrive
from drivecomm.commissioning.doctor.panel import panel_readings
from drivecomm.commissioning.doctor.trials import PATIENCE_S, needed_options
from drivecomm.errors import DriveError, LineBusyError, OvertakenError, ReplyError, in_one_line
from drivecomm.link import likely_damage

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from drivecomm.bus import Drive
    from drivecomm.commissioning.doctor.panel import PanelReading
    from drivecomm.link import Damage, Echo, Port, TraceEvent
    from drivecomm.protocol import DriveConfig, LineSettings, Protocol as InstalledProtocol

OTHER_RATES = (4800, 9600, 19200, 38400, 57600, 115200)

# A single lost telegram does not count as silence.
_TRIES = 3
# Single bytes of noise also occur within many telegrams.
_SHORTEST_ECHO = 3
# Uneven pauses reveal replies that come at the ticks of a latency timer.
_PAUSES_S = (0.0, 0.005, 0.011, 0.003, 0.007, 0.013, 0.002, 0.009)


def measure(
    port: Port,
    *,
    only: Iterable[str] | None = None,
    addresses: Iterable[int] | None = None,
    expected: Iterable[DriveConfig] = (),
    echo: Echo = "off",
    listen_s: float = 1.0,
    probes: int = 24,
    search: bool = True,
    trace: Callable[[TraceEvent], None] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
    **facts: Any,
) -> Measurements:
    """Measure an open port and its line; takes some seconds, and longer if few drives answer.

    only, addresses, facts: see `Bus.scan` and `open_bus`. expected: drives that should be on the line; they are probed
    at their own settings before the search for others. echo: the user's echo setting; the measured echo takes
    precedence. listen_s: listening time without requests, for each line setting. probes: number of probes to each drive
    that was found. search: try other baud rates if no drive answers. Raises LinkError if the port fails.
    """
    only = None if only is None else list(only)
    facts = {name: value for name, value in facts.items() if value is not None}
    heard = listen(port, only=only, echo=echo, listen_s=listen_s, progress=progress, **facts)
    bus = open_bus(lambda: port, echo="expect" if heard.echoes else "auto", trace=trace, **{"attempts": 1, **facts})
    return ask(
        bus, heard, only=only, addresses=addresses, expected=expected, probes=probes, search=search,
        rates=search and heard.carries_settings, progress=progress, **facts,
    )  # fmt: skip


class ExaminedBus(Protocol):
    """Interface of a bus that the doctor needs: a `Bus`, or the line of a server."""

    def drive(self, protocol: str, address: int, **options: Any) -> Any:
        """Return a drive with blocking verbs."""

    def scan(
        self,
        only: Iterable[str] | None = None,
        addresses: Iterable[int] | None = None,
        *,
        progress: Callable[[str, int, int], None] | None = None,
        **options: Any,
    ) -> Iterable[Found]:
        """Yield the drives that answer."""

    def listen(self, listener: Callable[[TraceEvent], None]) -> Callable[[], None]:
        """Report the traffic of this bus to a listener; return a function that stops the reports."""

    def now(self) -> float:
        """Return the time of the line's clock in seconds."""

    def sleep_until(self, until: float) -> None:
        """Sleep until a time of the line's clock; other callers may use the line."""


def ask(bus: ExaminedBus, heard: IdleObservation, **how: Any) -> Measurements:
    """Probe the expected drives, then search for others, and measure the reply times of all that answer.

    Each request is a separate call, between which other callers may use the line. heard: observations of the idle port.
    how: `only`, `addresses`, `expected`, `probes`, `search`, `progress` and facts as for `measure`; rates: try other
    baud rates if no drive answers.
    """
    recorder = _Recorder()
    end = bus.listen(recorder)
    try:
        return _asked(bus, recorder, heard, **how)
    finally:
        end()


def _asked(
    bus: ExaminedBus,
    recorder: _Recorder,
    heard: IdleObservation,
    *,
    only: Iterable[str] | None,
    addresses: Iterable[int] | None,
    expected: Iterable[DriveConfig],
    probes: int,
    search: bool,
    rates: bool,
    progress: Callable[[str, int, int], None] | None,
    **facts: Any,
) -> Measurements:
    only = None if only is None else list(only)
    plugins = list(dict.fromkeys(plugin for plugin, _ in scan_plan(only, None)))
    wanted = None if addresses is None else list(addresses)
    step = progress or (lambda *_: None)
    names = [plugin.name for plugin in plugins]
    sought = [_sought(bus, one, recorder, step, search=search, elsewhere=rates) for one in expected]
    places = {(one.drive.protocol, one.drive.address) for one in sought}
    found = [
        one
        for each in (names if only is None else only)
        for plugin in dict.fromkeys(plugin for plugin, _ in scan_plan([each], None))
        for one in bus.scan([each], _others(plugin, wanted, places), progress=progress)
    ]
    # Drives that answered are probed again below; bytes from an address without a drive need an explanation.
    known = {one.name for one in found} | {f"{protocol}:{address}" for protocol, address in places}
    unclear = sum(number for name, number in recorder.unclear.items() if name not in known)
    there: list[tuple[str, Callable[..., Drive]]]
    there = [(one.drive.name, partial(_built, bus, one.drive)) for one in sought if not one.error]
    there += [(one.name, partial(bus.drive, one.protocol, one.address, **one.options)) for one in found if one.sound]
    replies = []
    for name, build in there:
        step(f"asking {name} {probes} times", 0, 1)
        asked = _ask_often(bus, build(), recorder, probes, name)
        if search and len(asked.times_s) < probes:
            step(f"looking for what {name} needs", 0, 1)
            asked = replace(asked, needs=needed_options(build))
        replies.append(asked)
    panel = [reading for one in sought for reading in _panel(bus, one, step)]
    looking = rates and not found and not sought and "baudrate" not in facts
    elsewhere = list(_search(bus, plugins, wanted, step)) if looking else []
    return Measurements(
        paced=heard.paced,
        echo_said=heard.echo,
        noise=heard.noise,
        echo=heard.trials,
        asked=settings_of(only, facts),
        addresses=len(scan_plan(names, wanted)),
        found=found,
        replies=replies,
        unclear_bytes=unclear,
        elsewhere=elsewhere,
        sought=sought,
        panel=panel,
        carries_settings=heard.carries_settings,
    )


def _others(plugin: InstalledProtocol, wanted: Sequence[int] | None, places: set[tuple[str, int]]) -> list[int]:
    """Return the addresses to search for drives that are not expected."""
    addresses = plugin.scan_addresses if wanted is None else wanted
    return [one for one in addresses if (plugin.name, one) not in places]


def _built(bus: ExaminedBus, config: DriveConfig, **options: Any) -> Any:
    return config.with_options(**options).build(bus.drive)


def _sought(
    bus: ExaminedBus,
    one: DriveConfig,
    recorder: _Recorder,
    step: Callable[[str, int, int], None],
    *,
    search: bool,
    elsewhere: bool,
) -> SearchedDrive:
    """Probe a drive at its own settings, then with more time and longer pauses, then at other usual baud rates."""
    step(f"asking {one.name}", 0, 1)
    drive = one.build(bus.drive)
    recorder.forget()
    settings, error = drive.facts.settings, _no_answer(drive, _TRIES)
    recorder.settle()
    seen: dict[str, Any] = {"came": tuple(recorder.damaged), "answered_by": recorder.answered_by}
    if error and search:
        step(f"asking {one.name} with more time", 0, 1)
        if needs := needed_options(partial(_built, bus, one)):
            return SearchedDrive(drive=one, settings=settings, error=error, needs=needs, **seen)
    rates = [rate for rate in OTHER_RATES if rate != settings.baudrate] if error and elsewhere else []
    for number, rate in enumerate(rates):
        step(f"asking {one.name} at {rate} baud", number, len(rates))
        drive = one.with_options(baudrate=rate).build(bus.drive)
        if not _no_answer(drive, 1):
            return SearchedDrive(drive=one, settings=settings, error=error, elsewhere=drive.facts.settings, **seen)
    return SearchedDrive(drive=one, settings=settings, error=error, **seen)


def _panel(bus: ExaminedBus, sought: SearchedDrive, step: Callable[[str, int, int], None]) -> Iterator[PanelReading]:
    """Yield the panel settings that a drive reports, wherever it answers; yields nothing for a silent drive."""
    found = {} if sought.elsewhere is None else {"baudrate": sought.elsewhere.baudrate}
    if not sought.error or found or sought.needs:
        step(f"reading the panel settings of {sought.drive.name}", 0, 1)
        yield from panel_readings(_built(bus, sought.drive, **found, **sought.needs), sought.drive, sought.settings)


def _no_answer(drive: Drive, tries: int) -> str:
    """Return why a drive counts as silent, or an empty string if it answers."""
    error = ""
    while tries:
        try:
            drive.probe()
        except (OvertakenError, LineBusyError):
            # No request was sent, so this try does not count.
            continue
        except ReplyError as failure:
            error, tries = in_one_line(failure), tries - 1
        except DriveError:
            # A refusal also shows that the drive is there.
            return ""
        else:
            return ""
    return error


class _Recorder:
    """Recorder that matches replies to requests and collects bytes that belong to neither."""

    def __init__(self) -> None:
        self.unclear: Counter[str] = Counter()
        """Number of bytes that belong to no reply, by the drive of the request."""

        self.forget()

    def forget(self) -> None:
        """Start again with another drive."""
        self.pairs: list[tuple[TraceEvent, TraceEvent]] = []
        self.noise: list[bytes] = []
        """Noise received together with sound replies."""

        self.damaged: list[bytes] = []
        """Bytes received instead of a sound reply."""

        self.answered_by: int | None = None
        self._sent: TraceEvent | None = None
        self._answered = False
        self._pieces: list[TraceEvent] = []

    def __call__(self, event: TraceEvent) -> None:
        if event.what == "sent":
            self.settle()
            self._sent, self._answered = event, False
        elif event.what == "received" and self._sent is not None and not self._answered:
            self.pairs.append((self._sent, event))
            self._answered = True
        elif event.what == "stray":
            self.answered_by = getattr(event.message, "address", None)
        elif event.what in ("noise", "damaged") and not self._is_echo(event.data):
            self.unclear[event.drive] += len(event.data)
            self._pieces.append(event)

    def settle(self) -> None:
        """Sort the bytes that were received for the last request."""
        pieces, self._pieces = self._pieces, []
        noise = b"".join(each.data for each in pieces if each.what == "noise")
        damaged = [each.data for each in pieces if each.what == "damaged"]
        if self._answered and noise:
            self.noise.append(noise)
        elif not self._answered and (noise or damaged):
            # A damaged telegram is searched again without its first byte, so the longest piece is whole.
            self.damaged.append(max(damaged, key=len) if damaged else noise)

    def _is_echo(self, data: bytes) -> bool:
        # The echo of an unanswered telegram appears as noise before the next telegram.
        return self._sent is not None and len(data) >= _SHORTEST_ECHO and data in self._sent.data


def _ask_often(bus: ExaminedBus, drive: Drive, recorder: _Recorder, probes: int, name: str) -> Replies:
    recorder.forget()
    number = 0
    while number < probes:
        try:
            drive.probe()
        except (OvertakenError, LineBusyError):
            # No request was sent, so this probe does not count.
            continue
        except (ReplyError, DriveError):
            # A lost reply shows as the difference between probes and recorded replies.
            pass
        else:
            bus.sleep_until(bus.now() + _PAUSES_S[number % len(_PAUSES_S)])
        number += 1
    recorder.settle()
    settings = drive.facts.settings
    return Replies(
        drive=name,
        settings=settings,
        reply_timeout_s=drive.facts.timing.reply_timeout_s,
        asked=probes,
        times_s=[reply.time - sent.time for sent, reply in recorder.pairs],
        wire_s=[settings.wire_s(len(sent.data) + len(reply.data)) for sent, reply in recorder.pairs],
        arrivals_s=[reply.time for _, reply in recorder.pairs],
        noise=tuple(recorder.noise),
        damaged=tuple(recorder.damaged),
        damage=_usual_damage(drive, recorder.damaged),
    )


def _usual_damage(drive: Drive, damaged: Sequence[bytes]) -> Damage | None:
    """Return the probable damage of most of these replies; None if they have nothing in common."""
    likely = Counter(likely_damage(data, drive.peer.codec, "reply") for data in damaged)
    return likely.most_common(1)[0][0] if likely else None


def _search(
    bus: ExaminedBus,
    plugins: Sequence[InstalledProtocol],
    addresses: Sequence[int] | None,
    step: Callable[[str, int, int], None],
) -> Iterator[tuple[Found, LineSettings]]:
    """Probe one address of each protocol with more time, then at the other usual baud rates."""
    for plugin in plugins:
        usual = plugin.facts.settings.baudrate
        address = next((one for one in addresses or plugin.scan_addresses if one in plugin.addresses), None)
        if address is None:
            continue
        step(f"asking {plugin.name}:{address} with more time", 0, 1)
        if late := list(bus.scan([plugin.name], [address], reply_timeout_s=PATIENCE_S)):
            # Late replies of this drive would be taken for replies at the next baud rate.
            yield from ((found, plugin.facts.settings) for found in late if found.sound)
            continue
        for number, rate in enumerate(OTHER_RATES):
            if rate == usual:
                continue
            step(f"asking {plugin.name}:{address} at {rate} baud", number, len(OTHER_RATES))
            for found in bus.scan([plugin.name], [address], baudrate=rate):
                if found.sound:
                    yield found, bus.drive(plugin.name, address, baudrate=rate).facts.settings
