"""Supervised doors, each in its own thread: a door that fails, hangs or cannot be opened affects nothing else."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress
from importlib.metadata import entry_points
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError, in_one_line, suggestion
from drivecomm.link import Backoff
from drivecomm.server.door import DoorHealth, ReportsHealth
from drivecomm.server.observations import DoorSnapshot

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.server.door import Door, MakeDoor, ServedPlant

GROUP = "drivecomm.doors"
_FIRST_S, _LONGEST_S = 0.5, 30.0
_LOOP_AGAIN_S = 5.0
"""Pause before the next attempt to create an event loop."""
_END_S = 3.0

_log = logging.getLogger("drivecomm.server")


def kind_of_door(kind: str) -> MakeDoor:
    """Return the factory of a kind of door. Raises UsageError if it is not installed, or cannot be loaded."""
    found = {each.name: each for each in entry_points(group=GROUP)}
    if kind not in found:
        raise UsageError(f"there is no kind of door {kind!r}; {suggestion(kind, found, 'installed are')}")
    try:
        made: Any = found[kind].load()
    except Exception as error:
        raise UsageError(f"the kind of door {kind!r} cannot be loaded: {error}") from error
    return made  # type: ignore[no-any-return]


class OpenDoor:
    """A door in its own thread, reopened when it fails.

    told: called in that thread with a sentence for each event.
    """

    def __init__(self, door: Door, plant: ServedPlant, told: Callable[[str], None]) -> None:
        self.door = door
        self.opened = Event()
        self.failed = ""
        """The reason why the door is not open."""
        self._plant = plant
        self._told = told
        self._closing = False
        self._ends = Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._task: asyncio.Task[None] | None = None
        self._thread = Thread(target=self._work, name=f"door {door.name}", daemon=True)
        self._thread.start()

    def state(self, last_row: int | None) -> DoorSnapshot:
        """Return the state of the door. last_row: the latest row of the history, None without a history."""
        health = DoorHealth()
        if isinstance(self.door, ReportsHealth):
            try:
                health = self.door.health()
            except Exception:  # noqa: BLE001 - a faulty door must not hide the others
                _log.exception("health of door %s", self.door.name)
                health = DoorHealth(up=False)
        delivered = health.delivered_row
        return DoorSnapshot(
            name=self.door.name,
            up=self.opened.is_set() and health.up,
            clients=health.clients,
            backlog_rows=None if last_row is None or delivered is None else max(0, last_row - delivered),
        )

    def close(self) -> None:
        """Stop the door; a door that hangs is abandoned after a few seconds."""
        self._closing = True
        self._ends.set()
        loop, task = self._loop, self._task
        # Before Python 3.12, `wait_for` may lose a cancellation; the second one then takes effect.
        for _ in range(2):
            if loop is not None and task is not None and self._thread.is_alive():
                with suppress(RuntimeError):
                    loop.call_soon_threadsafe(task.cancel)
            self._thread.join(_END_S / 2)
        if self._thread.is_alive():
            self._told(f"door {self.door.name} does not stop; it is abandoned")

    def _work(self) -> None:
        # A door may need another kind of event loop than the default of the system.
        factory = getattr(self.door, "loop_factory", None)
        while not self._closing:
            try:
                with suppress(asyncio.CancelledError), asyncio.Runner(loop_factory=factory) as runner:
                    runner.run(self._serve())
            except Exception as error:  # noqa: BLE001 - such as no file descriptor left for an event loop
                self.failed = in_one_line(error)
                self._told(f"door {self.door.name} failed: {self.failed}")
                self._ends.wait(_LOOP_AGAIN_S)
            else:
                return

    async def _serve(self) -> None:
        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        waiting = Backoff(_FIRST_S, _LONGEST_S)
        while not self._closing:
            try:
                await self.door.run(self._plant, self.opened.set)
            except asyncio.CancelledError:
                if self._closing:
                    raise
                self.failed = "it was cancelled from inside"
                self._told(f"door {self.door.name} failed: {self.failed}")
            except (Exception, SystemExit) as error:  # noqa: BLE001 - no door may stop the server
                if isinstance(error, AttributeError | TypeError | KeyError | NameError):
                    _log.exception("door %s", self.door.name)
                self.failed = in_one_line(error)
                self._told(f"door {self.door.name} failed: {self.failed}")
            else:
                self._told(f"door {self.door.name} has ended unexpectedly")
            if self.opened.is_set():
                # The door worked until now, so the next attempt may follow soon.
                waiting.succeeded()
                self.opened.clear()
            waiting.failed(self._loop.time())
            await asyncio.sleep(waiting.over_at - self._loop.time())
            self._told(f"door {self.door.name} is opened again")
