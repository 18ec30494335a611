"""The control server of `start`: other programs of the same user have it stop drives on the line that it holds.

It stops any drive of its line over the bus that it has open. When its own drive is among them, `start` ends as it does
with Ctrl-C, and answers when it has. Nothing can be started this way.

A request is one line: {"order": "stop", "how": "ramp", "protocols": [[NAME, OPTIONS], ...], "everything": false,
"drives": [[NAME, PROTOCOL, ADDRESS, OPTIONS], ...]}. An answer is one line for each, and a last one.
"""

from __future__ import annotations

import os
import time
from contextlib import contextmanager, suppress
from functools import partial
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from drivecomm.cli.control.sockets import ControlSocket, socket_file
from drivecomm.cli.output import complain, sentence
from drivecomm.cli.stop.one_drive import as_far_as_possible
from drivecomm.errors import DriveCommError, NotSupported
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.bus import Broadcast, Drive
    from drivecomm.cli.control.sockets import Connection

_REQUEST_S = 2.0
_ACCEPT_S = 0.2
# To end: a stop with all its attempts, and the watchdog's parameters.
_END_S = 12.0
_NOT_UNDERSTOOD = (KeyError, TypeError, ValueError)


@contextmanager
def control_server(drive: Drive, port: str, end: Callable[[Stop], None], *, as_json: bool) -> Iterator[Event]:
    """Let other programs stop drives on this line during the block.

    Yields an event that is set when the block's own drive is to be stopped. end: stops it that way and ends the block.
    A server that cannot be opened is reported, and does not prevent the start.
    """
    if not drive.bus.real_time:
        yield Event()
        return
    try:
        server = ControlServer(drive, ControlSocket(socket_file(port)), end)
    except (OSError, DriveCommError) as error:
        complain(f"a stop from another program will not reach this one ({error}); use Ctrl-C", as_json=as_json)
        yield Event()
        return
    try:
        yield server.stopping
    except BaseException:
        server.close(failed=True)
        raise
    server.close(failed=False)


class ControlServer:
    """Serves the clients of a control socket in threads. stopping: set when its own drive is to be stopped."""

    def __init__(self, drive: Drive, sock: ControlSocket, end: Callable[[Stop], None]) -> None:
        self._drive = drive
        self._bus = drive.bus
        self._socket = sock
        self._end = end
        self.stopping = Event()
        self._ended = Event()
        self._failed = False
        self._clients: list[Thread] = []
        self._thread = Thread(target=self._accept, name=f"control server of {drive.name}", daemon=True)
        self._thread.start()

    def close(self, *, failed: bool) -> None:
        """Tell the clients that wait for it whether the drive was left as it should be; wait until they know."""
        self._failed = failed
        self._ended.set()
        self._thread.join()
        self._socket.close()
        until = time.monotonic() + _END_S
        for client in self._clients:
            client.join(max(0.0, until - time.monotonic()))

    def _accept(self) -> None:
        while not self._ended.is_set():
            connection = self._socket.accept(_ACCEPT_S)
            if connection is not None:
                self._clients = [client for client in self._clients if client.is_alive()]
                self._clients.append(Thread(target=self._serve, args=(connection,), daemon=True))
                self._clients[-1].start()

    def _serve(self, connection: Connection) -> None:
        def tell(**content: Any) -> None:
            # A client that has gone meanwhile wants its stop all the same.
            with suppress(OSError):
                connection.write(**content)

        try:
            tell(pid=os.getpid(), drive=self._drive.name)
            request = connection.read(_REQUEST_S)
            self._stop(Stop(request["how"]), request, tell)
        except _NOT_UNDERSTOOD as error:
            tell(over=True, ended=False, error=f"the request is not understood: {error!r}")
        except OSError:
            # It connected only to see whether a program is here.
            pass
        finally:
            connection.close()

    def _stop(self, how: Stop, request: dict[str, Any], tell: Callable[..., None]) -> None:
        if request["order"] != "stop":
            raise ValueError(request["order"])
        protocol, _, address = self._drive.name.partition(":")
        own = (protocol, int(address))
        protocols = [(str(name), dict(options)) for name, options in request["protocols"]]
        drives = [(str(name), str(protocol), int(at), dict(more)) for name, protocol, at, more in request["drives"]]
        concerned = bool(request["everything"]) or own[0] in {name for name, _ in protocols}
        named = [name for name, *address, _ in drives if tuple(address) == own]
        if concerned or named:
            # First, so that it does not start what is being stopped.
            self.stopping.set()
        for name, options in protocols:
            tell(protocol=name, **_stopped(how, partial(self._bus.broadcast, name), options))
        used = how if how in self._drive.capabilities.stops else Stop.RAMP
        # Ending has the watchdog's parameters to write, which a stop that comes meanwhile would go before.
        told = _stopped(used, lambda: self._drive, {}) if concerned or named else {}
        for name, kind, at, options in drives:
            if (kind, at) != own:
                tell(drive=name, **_stopped(how, partial(self._bus.drive, kind, at), options))
        if not told:
            tell(over=True, ended=False)
            return
        self._end(used)
        ended = self._ended.wait(_END_S) and not self._failed
        if ended:
            # It was stopped once more.
            told = {**told, "error": "", "exit_code": 0}
        for name in named or [self._drive.name]:
            tell(drive=name, **told)
        tell(over=True, ended=ended)


def _stopped(how: Stop, whom: Callable[..., Drive | Broadcast], options: dict[str, Any]) -> dict[str, Any]:
    """Stop a drive, or all of a protocol, by the ramp where they cannot otherwise; return what became of it."""
    told = {"how": how.value, "error": "", "exit_code": 0}
    try:
        one, _ = as_far_as_possible(whom, options)
        try:
            one.stop(how)
        except NotSupported:
            if how is Stop.RAMP:
                raise
            told["how"] = Stop.RAMP.value
            one.stop(Stop.RAMP)
    except DriveCommError as error:
        told |= {"error": sentence(error), "exit_code": error.exit_code}
    return told
