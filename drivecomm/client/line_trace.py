"""Trace of a line of a server, for --trace and --record, and for sniffing."""

from __future__ import annotations

import math
import threading
import time
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.client.connection import LocalServer
from drivecomm.client.line_streams import path_of
from drivecomm.client.wire import error_of
from drivecomm.errors import DriveCommError, LinkDownError
from drivecomm.link import TraceEvent
from drivecomm.protocol import decode
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from drivecomm.capture import Piece, Record
    from drivecomm.client.line_of_server import LineOfServer
    from drivecomm.client.registration import Registration
    from drivecomm.protocol import LineSettings, Message

Listener: TypeAlias = "Callable[[TraceEvent], None]"

# The trace reports events immediately, but over another connection than the results of requests.
_AFTERWARDS_S = 0.05
_BEGIN_S = 1.0
_SENT = frozenset({"sent"})
_HEARD = frozenset({"received", "stray", "damaged", "noise"})


@contextmanager
def traced(bus: LineOfServer, trace: Listener | None, record: Record | None) -> Iterator[None]:
    """Pass the events of a line to a trace function and a recording during the block.

    The events include those of all other clients. A trace function that raises an error is not called again, the
    recording continues, and the error is raised at the end of the block.
    """
    begun, over = threading.Event(), threading.Event()
    raised: list[Exception] = []
    with bus.server.stream(path_of(bus.line, "trace")) as news, _recording(bus, record) as keep:

        def listen() -> None:
            ends_s = math.inf
            for event in events_of(news):
                begun.set()
                if event is not None:
                    keep(event)
                    if trace is not None and not raised:
                        try:
                            trace(event)
                        except Exception as error:  # noqa: BLE001 - raised again at the end of the block
                            raised.append(error)
                if over.is_set():
                    ends_s = min(ends_s, time.monotonic() + _AFTERWARDS_S)
                    # The trace of a line with other active clients never pauses, so the time limit ends it.
                    if event is None or time.monotonic() >= ends_s:
                        return

        thread = threading.Thread(target=_until_lost, args=(listen,), name=f"trace of {bus.line}", daemon=True)
        thread.start()
        # The first line or the first tick without one shows that the trace is complete from then on.
        begun.wait(_BEGIN_S)
        try:
            yield
        finally:
            over.set()
            thread.join()
    if raised:
        raise raised[0]


def events_of(news: Iterator[Any]) -> Iterator[TraceEvent | None]:
    """Yield the trace events of a stream, None for a tick without events."""
    for each in news:
        if each is not None and "error" in each:
            raise error_of(each["error"])
        # The first line only shows that the server has started the trace.
        yield _event_of(each) if each is not None and "what" in each else None


class LineEar:
    """Listen-only port for sniffing: the bytes that a server sends and receives on a line."""

    def __init__(self, server: Registration, line: str) -> None:
        self.spoilt = 0
        self._stack = ExitStack()
        self._news = self._stack.enter_context(LocalServer(server).stream(path_of(line, "trace")))

    def configure(self, settings: LineSettings) -> str:  # noqa: ARG002 - the server sets the line settings
        """Return a note that the server listens with its own line settings."""
        return "through its server, with the settings of its drives"

    def read(self, until: float) -> bytes:
        """Return the next bytes as soon as there are any; empty at `until`. Raises ServerLostError."""
        for event in events_of(self._news):
            if event is not None and _is_on_line(event):
                return event.data
            if self.now() >= until:
                return b""
        raise LinkDownError("the server has ended its trace of the line")

    def now(self) -> float:
        """Return the monotonic time of this machine in seconds."""
        return time.monotonic()

    def close(self) -> None:
        """Stop listening."""
        self._stack.close()


def _until_lost(listen: Callable[[], None]) -> None:
    try:
        listen()
    except DriveCommError:
        # Every request to the lost server reports the loss.
        return


@contextmanager
def _recording(bus: LineOfServer, record: Record | None) -> Iterator[Listener]:
    if record is None:
        yield lambda _: None
        return
    from drivecomm.capture import CaptureWriter, Provenance

    began_s = time.monotonic()

    def keeping(add: Callable[[Piece], None]) -> Listener:
        def keep(event: TraceEvent) -> None:
            if _is_on_line(event):
                add(_piece_of(event, time.monotonic() - began_s))

        return keep

    if not isinstance(record, str | Path):
        yield keeping(record.add)
        return
    about = Provenance(
        began=datetime.now(UTC),
        tool=f"drivecomm {__version__}",
        port=bus.port,
        settings=bus.settings,
        drives=bus.names,
    )
    with CaptureWriter(record, about) as writer:
        yield keeping(writer.add)


def _is_on_line(event: TraceEvent) -> bool:
    return bool(event.data) and event.what in _SENT | _HEARD


def _piece_of(event: TraceEvent, time_s: float) -> Piece:
    from drivecomm.capture import Piece

    return Piece(time_s=time_s, data=event.data, source="master" if event.what in _SENT else "drive")


def _event_of(content: Mapping[str, Any]) -> TraceEvent:
    data = bytes.fromhex(content.get("data", ""))
    drive, what = str(content.get("drive", "")), content["what"]
    return TraceEvent(
        time=float(content.get("time", 0.0)),
        what=what,
        drive=drive,
        data=data,
        message=_message_of(drive, what, data),
        detail=str(content.get("detail", "")),
    )


def _message_of(drive: str, what: str, data: bytes) -> Message | None:
    """Return the decoded message of a telegram, None if it does not decode."""
    if what not in ("sent", "received", "stray") or not data:
        return None
    try:
        return decode(drive.partition(":")[0], data, direction="request" if what == "sent" else "reply").message
    except DriveCommError:
        return None
