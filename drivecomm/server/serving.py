"""The life of a server: the plant file, the core, its doors, and the signals of the system."""

from __future__ import annotations

import asyncio
import logging
import secrets
import signal
import sys
import time
from contextlib import AsyncExitStack, contextmanager, suppress
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from drivecomm.client import Registration, check_ports, local_socket, register, rewrite_record
from drivecomm.errors import DriveCommError, PortError
from drivecomm.plant import read_served_plant
from drivecomm.server.alarms import PlantAlarms, read_alarms
from drivecomm.server.audit import Audit
from drivecomm.server.backups.backing_up import Backups
from drivecomm.server.capacity import TakesConnections, needed_descriptors, share_connections, system_limits
from drivecomm.server.core import Core
from drivecomm.server.door import NamesDrives
from drivecomm.server.event_log import EventLog
from drivecomm.server.gc_tuning import search_everything
from drivecomm.server.history import HistoryWriter
from drivecomm.server.history_service import HistoryService, remembered_faults
from drivecomm.server.http import LocalDoor
from drivecomm.server.logins import Users
from drivecomm.server.notify import ServiceManager
from drivecomm.server.plan_check import report_overload
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.settings import read_settings
from drivecomm.server.spare import give_up_when_exhausted
from drivecomm.server.state_paths import state_folder
from drivecomm.server.supervision import OpenDoor, kind_of_door
from drivecomm.server.task_groups import cancel_and_wait
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from drivecomm.plant import Plant, PlantLine
    from drivecomm.server.door import Door
    from drivecomm.server.observations import EventKind
    from drivecomm.server.settings import ServerSettings

_log = logging.getLogger("drivecomm.server")

_TURN_S = 0.001

_ROOMS = (
    *("bus", "capture", "client", "commissioning", "commissioning.doctor", "commissioning.drift"),
    *("commissioning.exploring", "commissioning.parameter_sets", "line", "link"),
    *("models", "plant", "plant.value_log", "plant.value_plots", "plant.watching", "profiles", "protocol"),
    *("protocol.schema", "server.alarms", "server.history", "server.http", "transport", "virtual"),
)
"""Packages that threads of a server import from on first use."""

_OF_HTTP_DOORS = ("application", "callers", "guard", "metrics", "serving", "stream")
"""Modules of HTTP doors, imported before polling starts, because a thread imports slowly while lines are polled.

The local door always needs them.
"""

_FEW = 64
"""A door that gets fewer connections than this logs a warning."""
_SPARE = 8
"""Descriptors held in reserve for ports and files that must be reopened when no other is free."""

_OPEN_LOOK_S = 0.01
_OPEN_S = 20.0
"""Time limit for doors to open; after that, the server reports ready without them."""


class Serving:
    """The server of one plant file. Raises FileFormatError and UsageError for a file that cannot be served.

    port_of, doors: for tests; the port to open for a line instead of its own, and doors instead of those of the file.
    """

    def __init__(
        self,
        path: Path,
        *,
        port_of: Callable[[PlantLine], Any] | None = None,
        doors: Sequence[Door] | None = None,
    ) -> None:
        for room in _ROOMS:
            # Each import reads the list of its names; Python 3.11 fails if two threads do that at the same time.
            import_module(f"drivecomm.{room}")
        self.path = path
        self.plant = read_served_plant(path)
        self.settings = read_settings(path)
        self.socket = local_socket(path)
        self._local = LocalDoor(self.socket)
        self._rules = read_alarms(self.settings.alarms, self.plant.drives, self.settings.backups.drives)
        self._port_of = port_of
        said = self.settings.doors
        self._made = [kind_of_door(kind)(table) for kind, table in said] if doors is None else list(doors)
        for door in self._made:
            if isinstance(door, NamesDrives):
                door.check_plant(self.plant)
        self._manager = ServiceManager()
        self._reading: asyncio.Task[None] | None = None
        self._checking: asyncio.Task[None] | None = None
        self._wished = 0
        self._open = False
        self._end: asyncio.Event | None = None
        self._core: Core | None = None
        self._alarms: PlantAlarms | None = None
        self._backups: Backups | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def doors(self) -> list[str]:
        """The names of the doors, without the local one."""
        return [door.name for door in self._made]

    def end(self) -> None:
        """Stop the server; may be called from any thread, and repeatedly."""
        loop, end = self._loop, self._end
        if loop is not None and end is not None:
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(end.set)

    async def run(self, ready: Callable[[PlantForDoors], None]) -> None:
        """Serve until SIGTERM, Ctrl-C or `end`. ready: called when the doors are open, or after `_OPEN_S`.

        Raises UsageError if another server has the plant, PortError if the local door does not open, OSError for files
        that cannot be written.
        """
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        for module in _OF_HTTP_DOORS:
            import_module(f"drivecomm.server.http.{module}")
        # A computing thread, such as one that writes metrics, then yields sooner to the lines and the streams.
        sys.setswitchinterval(_TURN_S)
        self._share_connections()
        async with AsyncExitStack() as stack:
            record = stack.enter_context(register(self._registration()))
            stack.callback(self._manager.close)
            journal = self._journal(stack)
            session = secrets.token_urlsafe(9)
            audit = Audit(self.settings.audit, self._tell("server"), session=session)
            stack.push_async_callback(audit.close)
            core = self._core = Core(
                self.plant,
                session=session,
                audit=audit,
                journal=journal,
                users_file=str(self.settings.users or "the users file"),
                status_period_s=self.settings.status_period_s,
                port_of=self._port_of,
            )
            if self.settings.history:
                core.fault_logs.update(await asyncio.to_thread(remembered_faults, self.settings.history.file))
            core.table.listen(EventLog(lambda line: line in core.lines and core.lines[line].state().up).take)
            await stack.enter_async_context(core)
            plant = PlantForDoors(
                core,
                self.settings.name,
                read_rate=self.settings.read_rate,
                users=Users(self.settings.users, self._tell("server")) if self.settings.users else None,
                history=HistoryService(self.settings.history.file) if self.settings.history else None,
            )
            doors = [OpenDoor(door, plant, self._tell("door")) for door in (self._local, *self._made)]
            plant.set_doors(tuple(doors))
            self._backups = Backups(core, self.settings.backups, state=state_folder(self.path))
            if self._rules:
                self._alarms = PlantAlarms(
                    plant, self._rules, file=state_folder(self.path) / "alarms.json", write_event=self._written
                )
                plant.set_alarms(self._alarms)
                # Alarm deliveries run in their own thread, so they delay nothing else.
                doors.append(OpenDoor(self._alarms, plant, self._tell("alarm")))
            stack.push_async_callback(_closed, doors)
            # From here on, because a door may open slowly while another one already starts motors.
            with self._signals(core, record):
                await _opened(doors, self._end)
                if not doors[0].opened.is_set() and not self._end.is_set():
                    raise PortError(
                        f"the server cannot be reached at {self.socket}: {doors[0].failed or 'it does not open'}"
                    )
                # Without unix sockets, the address of the server is known only now.
                rewrite_record(record, self._registration())
                feeding = asyncio.create_task(self._manager.feed_watchdog())
                holding = asyncio.create_task(give_up_when_exhausted(_SPARE), name="spare descriptors")
                backing_up = asyncio.create_task(self._backups.run(), name="backups")
                self._manager.ready(self._size(core))
                core.table.record_event("server", f"begins, drivecomm {__version__}")
                self._check_polls(core)
                self._open = True
                if self._wished:
                    self._begin_reading(core, record)
                try:
                    ready(plant)
                    await self._end.wait()
                finally:
                    self._manager.stopping("stops the motors that it keeps")
                    await cancel_and_wait(backing_up)
                    core.table.record_event("server", "ends")
                    # Before the doors close, so that clients can watch the motors stop.
                    await core.release_all()
                    if self._reading is not None:
                        # A reload that is under way first leaves its lines in a consistent state.
                        await asyncio.wait([self._reading])
                    feeding.cancel()
                    holding.cancel()
                    await self._end_check()

    def _share_connections(self) -> None:
        """Set the number of connections that each door may hold, by the limits of this process."""
        doors = [door for door in self._made if isinstance(door, TakesConnections)]
        wishes, counts = (
            [door.connections for door in doors],
            {"lines": len(self.plant.lines), "doors": len(self._made)},
        )
        system = system_limits(needed_descriptors(wishes, **counts))
        self._local.connections, shares = share_connections(system, wishes, **counts)
        for door, wish, share in zip(doors, wishes, shares, strict=True):
            door.connections = share
            if share.most < min(wish.most, _FEW):
                _log.warning(
                    "door %s takes %d connections only, because the server may open %s files; raise its limit (ulimit "
                    "-n, or LimitNOFILE= of its service)", door.name, share.most, system.descriptors,
                )  # fmt: skip

    def _check_polls(self, core: Core) -> None:
        """Report the lines that do not keep up, some seconds later."""

        def report(line: str, text: str) -> None:
            core.table.record_event("line", text, line=line)

        self._checking = asyncio.create_task(report_overload(self.path, report), name="checking the polls")

    async def _end_check(self) -> None:
        if self._checking is not None:
            await cancel_and_wait(self._checking)

    def _registration(self, plant: Plant | None = None) -> Registration:
        """Return the public record of this server, as it is now or would be with another plant."""
        history = self.settings.history
        return Registration(
            plant=str(self.path.resolve()),
            name=self.settings.name,
            socket=self._local.socket,
            port=self._local.port,
            token=self._local.token,
            lines={line.name: line.reached_at for line in (plant or self.plant).lines},
            started_s=time.time(),
            history=str(history.file) if history else None,
            version=__version__,
        )

    def _journal(self, stack: AsyncExitStack) -> HistoryWriter | None:
        history = self.settings.history
        if history is None:
            return None
        history.file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        journal = HistoryWriter(history.file, history.days, history.megabytes, tell=self._tell("server"))
        stack.callback(journal.close)
        return journal

    def _tell(self, kind: EventKind) -> Callable[[str], None]:
        """Return a function that records a sentence as an event of this kind; it may be called in any thread."""

        def tell(text: str) -> None:
            self._written(kind, text)

        return tell

    def _written(self, kind: EventKind, text: str, **about: str) -> None:
        """Record an event from another thread. about: as of `ValueTable.record_event`."""
        loop, core = self._loop, self._core
        if loop is not None and core is not None:
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(partial(core.table.record_event, kind, text, **about))

    def _size(self, core: Core) -> str:
        return f"{len(core.lines)} lines, {len(core.plant.drives)} drives"

    @contextmanager
    def _signals(self, core: Core, record: Path) -> Iterator[None]:
        """Handle signals during the block: end the server, or read the plant file again."""
        loop, end = asyncio.get_running_loop(), self._end
        assert end is not None  # noqa: S101 - set for as long as `run` runs
        wished: dict[str, Callable[[], object]] = {
            "SIGTERM": end.set,
            "SIGINT": end.set,
            "SIGHUP": partial(self._read_again, core, record),
        }
        taken: list[Callable[[], object]] = []
        for name, do in wished.items():
            number = getattr(signal, name, None)
            # Handlers can only be set in the main thread; tests run servers in others.
            with suppress(RuntimeError, ValueError):
                if number is not None:
                    taken.append(_on_signal(loop, number, do))
        try:
            yield
        finally:
            for give_back in taken:
                give_back()

    def _take_alarms(self, core: Core, settings: ServerSettings) -> None:
        try:
            rules = read_alarms(settings.alarms, core.plant.drives, settings.backups.drives)
            if self._alarms is not None:
                self._alarms.change_rules(rules)
            elif rules:
                core.table.record_event("server", "alarms take effect after a restart of the server")
        except DriveCommError as error:
            core.table.record_event("warning", f"the alarms stay as they are: {error}")

    def _read_again(self, core: Core, record: Path) -> None:
        self._wished += 1
        if self._open:
            self._begin_reading(core, record)

    def _begin_reading(self, core: Core, record: Path) -> None:
        if self._reading is None or self._reading.done():
            self._reading = asyncio.create_task(self._reload_all(core, record), name="reading the plant file again")

    async def _reload_all(self, core: Core, record: Path) -> None:
        """Read the plant file again until no reload is requested: it may have changed during the last one."""
        while self._wished and not core.ending:
            self._wished = 0
            await self._reload(core, record)

    async def _reload(self, core: Core, record: Path) -> None:
        """Read the plant file again; keep everything unchanged if it cannot be read."""
        self._manager.reloading()
        try:
            plant = await asyncio.to_thread(read_served_plant, self.path)
            settings = await asyncio.to_thread(read_settings, self.path)
            await asyncio.to_thread(check_ports, self._registration(plant))
        except Exception as error:  # noqa: BLE001 - no plant file may stop the server
            core.table.record_event("warning", f"the plant file cannot be read, so nothing changes: {error}")
        else:
            said = await core.changed(plant)
            # Frees the objects that doors held for removed drives.
            search_everything()
            self.plant = plant
            if _of_a_start(settings) != _of_a_start(self.settings):
                core.table.record_event(
                    "server", "changes of doors and files take effect after a restart of the server"
                )
            with suppress(OSError):
                rewrite_record(record, self._registration())
            self._take_alarms(core, settings)
            if self._backups is not None:
                self._backups.change(settings.backups)
            core.table.record_event("server", f"plant file read again: {'; '.join(said) or 'nothing has changed'}")
            await self._end_check()
            self._check_polls(core)
        self._manager.ready(self._size(core))


def _of_a_start(settings: ServerSettings) -> list[object]:
    return [settings.audit, settings.read_rate, *((kind, table.content) for kind, table in settings.doors)]


def _on_signal(
    loop: asyncio.AbstractEventLoop, number: signal.Signals, do: Callable[[], object]
) -> Callable[[], object]:
    """Call `do` in the event loop on this signal; return a function that removes the handler.

    Raises RuntimeError and ValueError outside the main thread.
    """
    try:
        loop.add_signal_handler(number, do)
    except NotImplementedError:
        # The event loops of Windows have no signal handlers.
        before = signal.signal(number, lambda *_: loop.call_soon_threadsafe(do))
        return partial(signal.signal, number, before)
    return partial(loop.remove_signal_handler, number)


async def _opened(doors: list[OpenDoor], end: asyncio.Event) -> None:
    """Wait until the doors are open or the server is to end, but no longer than `_OPEN_S`."""
    until = time.monotonic() + _OPEN_S
    # Polled, because a thread that waits for them would delay the end of the server.
    while not end.is_set() and time.monotonic() < until:
        if all(door.opened.is_set() for door in doors):
            break
        await asyncio.sleep(_OPEN_LOOK_S)
    for door in doors:
        if not door.opened.is_set() and not end.is_set():
            _log.warning("door %s is not open yet", door.door.name)


async def _closed(doors: list[OpenDoor]) -> None:
    await asyncio.gather(*(asyncio.to_thread(door.close) for door in doors))
