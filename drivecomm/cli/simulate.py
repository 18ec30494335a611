"""The simulate command: virtual drives for other programs, in real time."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from drivecomm.cli.output import say
from drivecomm.errors import UsageError


def simulate(
    plant: Annotated[
        Path | None, typer.Argument(metavar="[PLANT]", help="A plant file: lines, drives, faults.")
    ] = None,
    drive: Annotated[
        list[str] | None,
        typer.Option("--drive", "-d", metavar="DRIVE", help="PROTOCOL:ADDRESS[,model=...]; repeat it for more."),
    ] = None,
    listen: Annotated[str, typer.Option("--listen", "-l", help="pty:PATH, tcp:HOST:PORT or rfc2217:HOST:PORT.")] = "",
    echo: Annotated[bool, typer.Option("--echo", help="Hand back what the master sends, as some adapters do.")] = False,
    paced: Annotated[bool, typer.Option("--paced", help="Characters take their time on the line.")] = False,
    speed: Annotated[
        float, typer.Option("--speed", metavar="N", help="Motors and faults go N times as fast; the lines do not.")
    ] = 1.0,
    control: Annotated[
        str,
        typer.Option("--control", metavar="PLACE", help="HOST:PORT or unix:PATH for drivecomm plant."),
    ] = "",
    json: Annotated[bool, typer.Option("--json", help="One JSON object per line.")] = False,
) -> int:
    """Serve virtual drives until Ctrl-C or SIGTERM. A master connects to them as to a real line.

    Either a plant file, or one line with --drive and --listen. A plant file has a control socket in any case, at a
    free port of this machine unless --control says where.
    """
    # Plants, sockets and pyserial are loaded only where something is served.
    from drivecomm.cli import simulation  # noqa: PLC0415

    if plant is None:
        server = simulation.server_of_drives(drive or [], listen, echo=echo, paced=paced, speed=speed, control=control)
        simulation.serve(server, ready=simulation.tell_drives_as_json if json else simulation.tell_drives)
    elif drive or listen or echo or paced:
        raise UsageError("a plant file says drives, places, echo and pacing itself; leave these options away")
    else:
        server = simulation.server_of_file(plant, speed=speed, control=control)
        tell = simulation.tell_plant_as_json if json else simulation.tell_plant
        simulation.serve(server, ready=partial(tell, path=plant))
    if not json:
        say("stopped")
    return 0
