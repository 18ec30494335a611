"""The door of `start`: other programs of the same user ask it to stop drives on the line that it holds.

It stops any drive of its line over the bus that it has open. When its own drive is concerned, it ends by that, as it
does with Ctrl-C, and answers when it has. Nothing can be started through it.

An order is one line: {"order": "stop", "how": "ramp", "protocols": [[NAME, OPTIONS], ...], "everything": false,
"drives": [[NAME, PROTOCOL, ADDRESS, OPTIONS], ...]}. An answer is one line for each, and a last one.
"""

from __future__ import annotations

import os
import time
from contextlib import contextmanager, suppress
from functools import partial
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, cast

from drivecomm.cli.door_places import Doorway, door_file
from drivecomm.cli.output import complain, sentence
from drivecomm.cli.stoppable import as_far_as_possible
from drivecomm.errors import DriveCommError, NotSupported
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.bus import Broadcast, Bus, Drive
    from drivecomm.cli.door_places import Connection

# An order comes at once from a program that has one.
_ORDER_S = 2.0
_LOOK_S = 0.2
# For leaving: a stop with all its attempts, and the watchdog's parameters.
_LONGEST_S = 12.0
_NOT_UNDERSTOOD = (KeyError, TypeError, ValueError)


@contextmanager
def door_of_start(drive: Drive, port: str, leave: Callable[[Stop], None], *, as_json: bool) -> Iterator[Event]:
    """Let other programs have drives on this line stopped for the time of the block.

    Gives what is set when the block's own drive is to be stopped. leave: ends the block by stopping it so. A door that
    cannot be opened is told of, and keeps nobody from starting.
    """
    if not drive.bus.real_time:
        yield Event()
        return
    try:
        door = _Door(drive, Doorway(door_file(port)), leave)
    except (OSError, DriveCommError) as error:
        complain(f"stop from another program will not reach this one ({error}); use Ctrl-C", as_json=as_json)
        yield Event()
        return
    try:
        yield door.asked
    except BaseException as error:
        door.close(sentence(error) if isinstance(error, DriveCommError) else type(error).__name__)
        raise
    door.close("")


class _Door:
    def __init__(self, drive: Drive, doorway: Doorway, leave: Callable[[Stop], None]) -> None:
        self._drive = drive
        self._bus = cast("Bus", drive.bus)
        self._doorway = doorway
        self._leave = leave
        self.asked = Event()
        self._left = Event()
        self._failure = ""
        self._guests: list[Thread] = []
        self._thread = Thread(target=self._let_in, name=f"door of {drive.name}", daemon=True)
        self._thread.start()

    def close(self, failure: str) -> None:
        """Tell those who wait for it that the drive has been left, or why it has not; wait until they know."""
        self._failure = failure
        self._left.set()
        self._thread.join()
        self._doorway.close()
        until = time.monotonic() + _LONGEST_S
        for guest in self._guests:
            guest.join(max(0.0, until - time.monotonic()))

    def _let_in(self) -> None:
        while not self._left.is_set():
            connection = self._doorway.let_in(_LOOK_S)
            if connection is not None:
                self._guests = [guest for guest in self._guests if guest.is_alive()]
                self._guests.append(Thread(target=self._talk, args=(connection,), daemon=True))
                self._guests[-1].start()

    def _talk(self, connection: Connection) -> None:
        def tell(**content: Any) -> None:
            # Who asked for a stop and has gone meanwhile wants it all the same.
            with suppress(OSError):
                connection.write(**content)

        try:
            tell(pid=os.getpid(), drive=self._drive.name)
            order = connection.read(_ORDER_S)
            self._stop(Stop(order["how"]), order, tell)
        except _NOT_UNDERSTOOD as error:
            tell(over=True, ended=False, error=f"the order is not understood: {error!r}")
        except OSError:
            # It came to see whether somebody is here.
            pass
        finally:
            connection.close()

    def _stop(self, how: Stop, order: dict[str, Any], tell: Callable[..., None]) -> None:
        if order["order"] != "stop":
            raise ValueError(order["order"])
        protocol, _, address = self._drive.name.partition(":")
        own = (protocol, int(address))
        protocols = [(str(name), dict(options)) for name, options in order["protocols"]]
        drives = [(str(name), str(protocol), int(at), dict(more)) for name, protocol, at, more in order["drives"]]
        concerned = bool(order["everything"]) or own[0] in {name for name, _ in protocols}
        named = [name for name, *address, _ in drives if tuple(address) == own]
        if concerned or named:
            # First, so that it does not start what is being stopped.
            self.asked.set()
        for name, options in protocols:
            tell(protocol=name, **_stopped(how, partial(self._bus.broadcast, name), options))
        used = self._way(how)
        # Ending has the watchdog's parameters to write, which a stop that comes meanwhile would go before.
        told = _stopped(used, lambda: self._drive, {}) if concerned or named else {}
        for name, kind, at, options in drives:
            if (kind, at) != own:
                tell(drive=name, **_stopped(how, partial(self._bus.drive, kind, at), options))
        if not told:
            tell(over=True, ended=False)
            return
        self._leave(used)
        ended = self._left.wait(_LONGEST_S) and not self._failure
        if ended:
            # It was stopped once more.
            told = {**told, "error": "", "exit_code": 0}
        for name in named or [self._drive.name]:
            tell(drive=name, **told)
        tell(over=True, ended=ended)

    def _way(self, how: Stop) -> Stop:
        return how if how in self._drive.capabilities.stops else Stop.RAMP


def _stopped(how: Stop, whom: Callable[..., Drive | Broadcast], options: dict[str, Any]) -> dict[str, Any]:
    """Stop a drive, or all of a protocol, by the ramp where they cannot otherwise; return what became of it."""
    used = how
    try:
        one, _ = as_far_as_possible(whom, options)
        try:
            one.stop(how)
        except NotSupported:
            if how is Stop.RAMP:
                raise
            used = Stop.RAMP
            one.stop(used)
    except DriveCommError as error:
        return {"how": used.value, "error": sentence(error), "exit_code": error.exit_code}
    return {"how": used.value, "error": "", "exit_code": 0}
