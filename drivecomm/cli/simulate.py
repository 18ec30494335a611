"""The simulate command: virtual drives for other programs, in real time."""

from __future__ import annotations

import signal
from threading import Event
from typing import Annotated

import typer

from drivecomm.cli.drive_names import parse_drive
from drivecomm.cli.output import emit, say
from drivecomm.virtual.drives import virtual_drive


def simulate(
    drive: Annotated[
        list[str],
        typer.Option("--drive", "-d", metavar="DRIVE", help="PROTOCOL:ADDRESS[,model=...]; repeat it for more."),
    ],
    listen: Annotated[str, typer.Option("--listen", "-l", help="pty:PATH, tcp:HOST:PORT or rfc2217:HOST:PORT.")],
    echo: Annotated[bool, typer.Option("--echo", help="Hand back what the master sends, as some adapters do.")] = False,
    paced: Annotated[bool, typer.Option("--paced", help="Characters take their time on the line.")] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object per line.")] = False,
) -> int:
    """Serve virtual drives until Ctrl-C or SIGTERM. A master connects to them as to a real line."""
    # pyserial is loaded only where a port is served.
    from drivecomm.virtual.listeners import parse_listen  # noqa: PLC0415
    from drivecomm.virtual.serving import Server  # noqa: PLC0415

    names = [parse_drive(text) for text in drive]
    drives = [virtual_drive(name.protocol, name.address, **name.options) for name in names]
    stop = Event()
    previous = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with Server(drives, parse_listen(listen), echo=echo, paced=paced) as server:
            if json:
                emit(listening=server.address, drives=[str(name) for name in names])
            else:
                say(f"{', '.join(str(name) for name in names)} on {server.address}; stop with Ctrl-C")
            server.run(stop)
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    if not json:
        say("stopped")
    return 0
