"""Stop of all drives at a port without a plant file."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

from drivecomm.cli.output import say
from drivecomm.cli.stop.concurrent_lines import bus_of, own_bus, stop_lines
from drivecomm.cli.stop.over_bus import StoppedLine, stop_protocol_of
from drivecomm.cli.stop.results import show
from drivecomm.cli.stop.served_lines import lines_of_server
from drivecomm.cli.stop.stop_ways import StopWays
from drivecomm.errors import DriveError, LinkError, UsageError
from drivecomm.protocol import installed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.bus import OnResult
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.cli.stop.safe_lookups import SafeLookups
    from drivecomm.client import Registration
    from drivecomm.protocol import Stop


def stop_port(line: LineArguments, how: Stop, spite: SafeLookups) -> int:
    """Stop all drives at the given port; return the exit code.

    Without a server, it can only send a broadcast for each protocol, which no drive confirms.
    """
    tell = partial(show, wanted=how, as_json=line.json)
    if line.port is None:
        raise UsageError("no port: give --port or set DRIVECOMM_PORT, and in a plant of several lines each its port")
    ways = StopWays(line.port, spite)
    for program, name in ways.programs:
        try:
            if program.plant:
                return _stopped_by_server(program, name, line, how, spite)
            _stop_by_holder(program, name, line, how, tell)
        except LinkError as error:
            spite.note(f"{error}; trying another way")
        else:
            return DriveError.exit_code
    unreached = []
    with own_bus(StoppedLine(port=line.port, opening=line.opening), ways) as bus:
        for name in installed:
            unreached += stop_protocol_of(bus, name, how, tell, as_json=line.json)
    if not line.json:
        with suppress(Exception):
            _explain(unreached, line.port)
    return DriveError.exit_code


def _explain(unreached: Sequence[str], port: str) -> None:
    say(
        "sent with each protocol's usual line settings, because only a plant file (--plant) gives others; no drive "
        "confirms a broadcast, so look at the motors"
    )
    for name in unreached:
        say(f"{name}: not stopped, because {_why_not(name, port)}")


def _why_not(name: str, port: str) -> str:
    """Return why the drives of a protocol were not stopped, with a remedy."""
    # Imported late, so that all stops are sent first.
    from drivecomm.models import is_monitoring_only, load_model

    plugin = installed[name]
    if is_monitoring_only(plugin, load_model(plugin.package, name, plugin.default_model)):
        return "its drives are monitored only; stop them where they are commanded from"
    alone = plugin.broadcast_address is None
    return (
        f"{'its drives have no broadcast' if alone else 'that needs the models of its drives'}; name them in a plant "
        "file, or stop each one separately: "
        f"drivecomm stop {name}:ADDRESS{'' if alone else ',model=MODEL'} --port {port}"
    )


def _stopped_by_server(program: Registration, name: str, line: LineArguments, how: Stop, spite: SafeLookups) -> int:
    """Stop the drives of a server's line; return the exit code. Raises LinkError if the server does not respond."""
    one = [each for each in lines_of_server(program, line) if each.name == name]
    return stop_lines(one, line, how, spite, whole=True)


def _stop_by_holder(program: Registration, name: str, line: LineArguments, how: Stop, tell: OnResult) -> None:
    """Stop all drives over the bus of a program that has the port. Raises LinkError if that fails."""
    from drivecomm.client import place_on_line, request_stop

    with suppress(UsageError):
        # The program's own kept motor is stopped even without a broadcast; most programs keep no motor.
        request_stop(program, place_on_line(name, "*:*"), how)
    with bus_of(program, name, line.opening) as bus:
        for protocol in installed:
            stop_protocol_of(bus, protocol, how, tell, as_json=line.json)
