"""What happens on a line of a server, as its own trace tells it: for --trace and --record, and for sniffing."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.client.line_streams import path_of
from drivecomm.errors import DriveCommError
from drivecomm.link import TraceEvent
from drivecomm.protocol import decode
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from drivecomm.capture import Piece, Record
    from drivecomm.client.connection import LocalServer
    from drivecomm.client.served_bus import ServedBus
    from drivecomm.protocol import Message

Listener: TypeAlias = "Callable[[TraceEvent], None]"

# What was done is told at once, but by another connection than its result.
_AFTERWARDS_S = 0.3
_SENT = frozenset({"sent"})
_HEARD = frozenset({"received", "stray", "damaged", "noise"})


@contextmanager
def traced(bus: ServedBus, trace: Listener | None, record: Record | None) -> Iterator[None]:
    """Tell a trace function and a recording what happens on a line, for the time of the block.

    Everything that happens there is told, whoever asked for it.
    """
    over = threading.Event()
    with bus.server.stream(path_of(bus.line, "trace")) as news, _recording(bus, record) as keep:

        def listen() -> None:
            for event in events_of(news):
                if event is not None:
                    keep(event)
                    if trace is not None:
                        trace(event)
                elif over.is_set():
                    return

        thread = threading.Thread(target=_until_lost, args=(listen,), name=f"trace of {bus.line}", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join(_AFTERWARDS_S)


def events_of(news: Iterator[Any]) -> Iterator[TraceEvent | None]:
    """Yield trace events of the lines of a stream, None where nothing came."""
    for each in news:
        # The first line only says that the server listens.
        yield None if each is None or "what" not in each else _event_of(each)


def pieces_of(server: LocalServer, line: str, seconds: float | None) -> Iterator[Piece]:
    """Yield what is said on a line, as pieces with times since now; empty ones while nothing is.

    seconds: for how long, None for without end.
    """
    from drivecomm.capture import Piece  # noqa: PLC0415 - for those who keep the bytes

    with server.stream(path_of(line, "trace")) as news:
        began_s = time.monotonic()
        for event in events_of(news):
            passed_s = time.monotonic() - began_s
            if seconds is not None and passed_s >= seconds:
                return
            if event is None or not _is_on_line(event):
                yield Piece(time_s=passed_s, data=b"")
            else:
                yield _piece_of(event, passed_s)


def _until_lost(listen: Callable[[], None]) -> None:
    try:
        listen()
    except (DriveCommError, OSError, ValueError):
        # The server has gone, of which whoever asks it something is told, or the stream was closed.
        return


@contextmanager
def _recording(bus: ServedBus, record: Record | None) -> Iterator[Listener]:
    if record is None:
        yield lambda _: None
        return
    from drivecomm.capture import CaptureWriter, Provenance  # noqa: PLC0415 - for those who record

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
    from drivecomm.capture import Piece  # noqa: PLC0415 - as above

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
    """Return what a telegram means, None where it is none."""
    if what not in ("sent", "received", "stray") or not data:
        return None
    try:
        return decode(drive.partition(":")[0], data, direction="request" if what == "sent" else "reply").message
    except DriveCommError:
        return None
