"""Virtual drives and plants in real time for other programs, over a pseudo-terminal, TCP or RFC 2217.

with Server([virtual_drive("vabus", 1)], parse_listen("tcp:127.0.0.1:0")) as server:
    print(server.address)
    server.run(stop)
"""

from __future__ import annotations

import selectors
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Self

from drivecomm.errors import UsageError
from drivecomm.virtual.control_socket import ControlServer, parse_socket_address
from drivecomm.virtual.line import VirtualLine
from drivecomm.virtual.listeners import OverhearingListener, ShowsSettings, parse_listen, parse_shared_listen
from drivecomm.virtual.timers import Timers
from drivecomm.virtual.timing_watch import SERVED_TOLERANCE_S
from drivecomm.virtual.waiting import ready_within

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from threading import Event

    from drivecomm.protocol import LineSettings, VirtualDrive
    from drivecomm.virtual.listeners import Listener
    from drivecomm.virtual.virtual_plant import VirtualPlant

# Longest delay until a stop is noticed.
_TICK_S = 0.1
_ROOM_S = 0.5
"""Limit for data that a master sends ahead, in seconds on the wire; further data waits on the master's side."""


class VirtualServedLine:
    """A virtual line coupled with a listener. Times are seconds of the line's own clock.

    A drive's transmission reaches the master when its last character has been sent. A master that sets no line
    settings, as over a pseudo-terminal or plain TCP, counts as using those with which each drive began.
    """

    def __init__(self, line: VirtualLine, listener: Listener) -> None:
        self.line = line
        self.listener = listener
        self._settings: LineSettings | None = None
        line.configure(None)
        self._shows = listener if isinstance(listener, ShowsSettings) else None
        if isinstance(listener, OverhearingListener):
            # A monitor is called promptly; recorders are called late, as the drives are.
            line.monitors.append(lambda sent: listener.overhear(sent.data))

    @property
    def descriptor(self) -> int | None:
        """The descriptor to watch for a master's bytes; None while it has sent too much ahead."""
        return None if self._is_full else self.listener.descriptor

    @property
    def due(self) -> float:
        """Time of the next event on the line without further data from the master; infinite if there is none."""
        return self._or_room(self.line.due)

    @property
    def deadline(self) -> float:
        """Latest time to process due events; until then the master cannot notice them."""
        return self._or_room(self.line.silent_until)

    def attend(self, now: float) -> None:
        """Process the bytes that the master has sent by this time."""
        data = self.listener.receive(0.0)
        self.line.pass_time(now)
        if self.listener.settings != self._settings:
            self._settings = self.listener.settings
            self.line.configure(self._settings)
        if data:
            if self._shows is not None:
                self.line.told_settings = self._shows.told_settings
            self.line.transmit(data)
        self.follow(now)

    def follow(self, now: float) -> None:
        """Advance the line's time to now, and send the master what it hears."""
        self.line.pass_time(now)
        heard = self.line.take()
        if heard:
            self.listener.send(heard)

    def _or_room(self, time: float) -> float:
        return min(time, self.line.time + self.line.backlog_s - _ROOM_S / 2) if self._is_full else time

    @property
    def _is_full(self) -> bool:
        return self.line.backlog_s > _ROOM_S


class LineServer:
    """Server for any number of virtual lines in one thread that wakes only for events and bytes.

    The lines' clocks follow the real clock from the moment in which the server is entered. Entering opens the listeners
    and the control socket, and raises PortError if one of them fails.
    """

    def __init__(self, lines: Sequence[VirtualServedLine], control: ControlServer | None = None) -> None:
        self.lines = lines
        self.on_tick: list[Callable[[], None]] = []
        """Called ten times a second while the lines are served."""
        self._control = control
        self._selector: selectors.BaseSelector | None = None
        self._watched: dict[VirtualServedLine, int | None] = {}
        self._timers = Timers[VirtualServedLine]()
        self._looked_at = 0.0
        self._watched_for_control: set[int] = set()
        self._began = time.monotonic()
        self._open = ExitStack()

    def now(self) -> float:
        """Return the time of the lines: seconds since the server was entered."""
        return time.monotonic() - self._began

    def run(self, stop: Event) -> None:
        """Serve until the event is set, and up to a tenth of a second longer; may be called again."""
        while not stop.is_set():
            self._serve_once()

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            self._selector = opened.enter_context(selectors.DefaultSelector())
            for listener in (served.listener for served in self.lines):
                opened.callback(listener.close)
                listener.open()
            if self._control is not None:
                opened.callback(self._control.close)
                self._control.open()
            self._open = opened.pop_all()
        self._watched = dict.fromkeys(self.lines)
        self._watched_for_control = set()
        self._began = time.monotonic()
        self._looked_at = 0.0
        for served in self.lines:
            self._watch(served)
        self._watch_control()
        return self

    def __exit__(self, *_: object) -> None:
        self._selector = None
        self._open.close()

    def _serve_once(self) -> None:
        selector = self._selector
        if selector is None:
            return
        now = self.now()
        for key in ready_within(selector, min(_TICK_S, self._timers.deadline - now)):
            now = self.now()
            if isinstance(key.data, VirtualServedLine):
                key.data.attend(now)
                self._watch(key.data)
            elif key.fd in self._watched_for_control:
                key.data.attend(key.fd)
                self._watch_control()
                self._look_again()
        now = self.now()
        if now - self._looked_at >= _TICK_S:
            # Another thread may have changed a line.
            self._look_again()
        while (served := self._timers.pop(now)) is not None:
            served.follow(now)
            self._watch(served)

    def _look_again(self) -> None:
        self._looked_at = self.now()
        for each in self.on_tick:
            each()
        for served in self.lines:
            self._timers.set(served, served.deadline)

    def _watch(self, served: VirtualServedLine) -> None:
        """Set the timer of a line, and register its listener's descriptor, which can change or be held back."""
        self._timers.set(served, served.deadline)
        before, wanted = self._watched[served], served.descriptor
        if self._selector is None or before == wanted:
            return
        if before is not None:
            self._selector.unregister(before)
        if wanted is not None:
            self._selector.register(wanted, selectors.EVENT_READ, served)
        self._watched[served] = wanted

    def _watch_control(self) -> None:
        if self._selector is None or self._control is None:
            return
        wanted = set(self._control.descriptors)
        for descriptor in self._watched_for_control - wanted:
            self._selector.unregister(descriptor)
        for descriptor in wanted - self._watched_for_control:
            self._selector.register(descriptor, selectors.EVENT_READ, self._control)
        self._watched_for_control = wanted


class Server(LineServer):
    """Virtual drives on one line whose master is another program.

    Every drive hears everything on the line and ignores telegrams to others. echo: the master hears itself, as with
    some two-wire adapters. paced: characters take their time at the drive's baud rate; a telegram then arrives when its
    last character would have. line: the virtual line itself, as in virtual time, for setting faults and switching
    drives off.
    """

    def __init__(
        self, drives: Iterable[VirtualDrive], listener: Listener, *, echo: bool = False, paced: bool = False
    ) -> None:
        self.line = VirtualLine(drives, echo=echo, paced=paced)
        self.drives = self.line.drives
        super().__init__([VirtualServedLine(self.line, listener)])

    @property
    def address(self) -> str:
        """The address that a master opens: a path, or a URL with the actual port number."""
        return self.lines[0].listener.address


class PlantServer(LineServer):
    """Server for the lines of a plant at their `listen` addresses, with an optional control socket.

    control: HOST:PORT or unix:PATH of the control socket, empty for none. The plant's time begins when the server is
    entered. While it runs, only its thread may use the plant; others send orders through the control socket. Raises
    UsageError for a line without `listen` and for an invalid control address.
    """

    def __init__(self, plant: VirtualPlant, *, control: str = "") -> None:
        self.plant = plant
        self._served: dict[str, VirtualServedLine] = {}
        for line in plant.plant.lines:
            if not line.listen:
                raise UsageError(
                    f"line {line.name} has no listen key; set it to pty:PATH, tcp:HOST:PORT or rfc2217:HOST:PORT"
                )
            listener = parse_shared_listen(line.listen) if line.listeners else parse_listen(line.listen)
            self._served[line.name] = VirtualServedLine(plant.line(line.name), listener)
        if control:
            plant.watch(tolerance_s=SERVED_TOLERANCE_S)
        super().__init__(
            list(self._served.values()),
            ControlServer(parse_socket_address(control), plant, self._be_now) if control else None,
        )

    @property
    def addresses(self) -> dict[str, str]:
        """The address that a master opens, by the name of the line."""
        return {name: served.listener.address for name, served in self._served.items()}

    @property
    def control(self) -> str:
        """The address of the control socket; empty if there is none."""
        return self._control.address if self._control else ""

    def _be_now(self) -> None:
        now = self.now()
        for served in self.lines:
            served.follow(now)
