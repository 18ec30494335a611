"""Command `scan`: the drives on a line."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from drivecomm.bus import LineChoices, scan_plan
from drivecomm.cli import options
from drivecomm.cli.line_command import LineCommand, LineSetting
from drivecomm.cli.output import counted, emit, note, progress_bar, say
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.values import FILE
from drivecomm.commissioning import forecast_scan
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.plant import ScannedLine, add_scanned, read_plant, scanned_text
from drivecomm.protocol import SETTING_NAMES
from drivecomm.tomlfile import write_atomically
from drivecomm.transport import ONE_PROTOCOL, scheme_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from drivecomm.bus import Found
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.commissioning import ScanForecast
    from drivecomm.protocol import DriveConfig

_LINE = "Line"
_MOST_NAMED = 8
"""Limit of models named in one line of the list."""


@click.command(cls=LineCommand)
@click.argument("ports", metavar="[PORT...]", nargs=-1, help="Ports to scan, one after the other; or --port.")
@options.only_protocols
@options.addresses
@click.option("--wide", is_flag=True, help="Also try other line settings, the likely ones first.")
@click.option("--baudrate", metavar="NUMBER", cls=LineSetting, help="Bits per second; several to try: 9600,19200.")
@click.option("--bytesize", metavar="NUMBER", cls=LineSetting, help="Data bits, 7 or 8; or 7,8.")
@click.option("--parity", metavar="LETTER", cls=LineSetting, help="N, E, O, M or S; several to try: E,N.")
@click.option("--stopbits", metavar="NUMBER", cls=LineSetting, help="1, 1.5 or 2; or 1,2.")
@click.option("--write", type=FILE, help="Write the drives found to a plant file.")
@click.option("--add", type=FILE, help="Add the drives that FILE, a plant file, does not have yet.")
@force_option
def scan(
    *,
    line: LineArguments,
    ports: tuple[str, ...],
    protocol: tuple[str, ...],
    addresses: list[int] | None,
    wide: bool,
    baudrate: str | None,
    bytesize: str | None,
    parity: str | None,
    stopbits: str | None,
    write: Path | None,
    add: Path | None,
    force: bool,
) -> int:
    """Find the drives on a line, or several, with telegrams that cannot move a motor. Exit code 1 if there are none.

    A plain scan asks each protocol's drives at their usual line settings. With --wide, or with several values for a
    setting, it tries others too. That takes long, so it first shows how long, and Ctrl-C keeps the drives found so far.
    """
    given = LineChoices(
        baudrates=tuple(_number(text, "baud rate") for text in _parts(baudrate)),
        bytesizes=tuple(_number(text, "number of data bits") for text in _parts(bytesize)),
        parities=tuple(text.upper() for text in _parts(parity)),  # type: ignore[misc]
        stopbits=tuple(_stop_bits(text) for text in _parts(stopbits)),
    )
    if line.plant is not None and "port" in line.given:
        line.refuse("the line is that of --port", "plant")
    tried = dict(zip(SETTING_NAMES, (given.baudrates, given.bytesizes, given.parities, given.stopbits), strict=True))
    several = wide or any(len(some) > 1 for some in tried.values())
    if not scan_plan(protocol or None, addresses):
        named = ", ".join(map(str, addresses or ()))
        raise UsageError(f"no drive of these protocols can have the address {named}; see drivecomm protocols")
    lines = _lines(line, ports)
    if write is not None and add is not None:
        raise UsageError("--write makes a new file, and --add changes one; give one of them")
    if add is not None:
        read_plant(add)
    must_be_free(write, "--write", force=force)
    # A scan gets either the settings to try, or single settings for all drives.
    settings = {"choices": given} if several else {name: some[0] for name, some in tried.items() if some}
    asked: dict[str, Any] = {"only": protocol or None, "addresses": addresses, **settings}
    for each in lines:
        if several and scheme_of(each.named_port) in ("socket", *ONE_PROTOCOL):
            raise UsageError(
                f"{each.port} carries no line settings, so others cannot be tried; use rfc2217://, or leave "
                "--wide and lists of settings out"
            )
    if several:
        _foretell(forecast_scan(**{**line.facts, **asked}), as_json=line.json)
        if not line.json:
            for warning in sorted(
                {plugin.wrong_settings for plugin, _ in scan_plan(protocol or None, addresses)} - {""}
            ):
                note(warning)
    scanned: list[ScannedLine] = []
    try:
        for each in lines:
            if len(lines) > 1 and not line.json:
                say(each.named_port)
            found: list[Found] = []
            scanned.append(ScannedLine(port=each.named_port, found=found, echo=each.echo == "expect"))
            _scan_line(each, asked, found, wide=several)
    except (DriveCommError, KeyboardInterrupt):
        # After Ctrl-C or a lost port, the drives found so far are still reported.
        if any(each.found for each in scanned):
            _report(scanned, write=write, add=add, as_json=line.json)
        raise
    _report(scanned, write=write, add=add, as_json=line.json)
    return 0 if any(each.found for each in scanned) else 1


def _lines(line: LineArguments, ports: tuple[str, ...]) -> list[LineArguments]:
    """Return the lines to scan. Raises UsageError."""
    if not ports:
        return [line]
    line.refuse("the ports are named here", "port")
    if line.record is not None and len(ports) > 1:
        raise UsageError("--record is for one line; scan one port with it")
    return [replace(line, port=port) for port in dict.fromkeys(ports)]


def _scan_line(line: LineArguments, asked: dict[str, Any], found: list[Found], *, wide: bool) -> None:
    with line.bus() as bus, progress_bar("asking", shown=not line.json) as progress:
        for one in bus.scan(**asked, progress=progress):
            found.append(one)
            if line.json:
                _emit(one, line)
            else:
                say(_line(one, wide=wide))


def _report(scanned: list[ScannedLine], *, write: Path | None, add: Path | None, as_json: bool) -> None:
    """Write the drives found to a file, and print their number."""
    found = [one for each in scanned for one in each.found]
    added: Sequence[DriveConfig] = ()
    if found and write is not None:
        write_atomically(write, scanned_text(scanned))
    if found and add is not None:
        added = add_scanned(add, scanned)
    if as_json:
        return
    sound = sum(one.sound for one in found)
    damaged = f", {counted(len(found) - sound, 'answer')} with damage only" if len(found) > sound else ""
    say(f"{counted(sound, 'drive')} found{damaged}")
    if write is not None:
        say(f"written to {write}" if found else f"{write} is not written")
    if add is not None:
        names = f": {', '.join(each.name for each in added)}" if added else ""
        say(f"{counted(len(added), 'drive')} added to {add}{names}")


def _foretell(forecast: ScanForecast, *, as_json: bool) -> None:
    if as_json:
        emit(questions=forecast.questions, settings=forecast.settings, seconds=round(forecast.seconds, 1))
        return
    settings = counted(forecast.settings, "line setting")
    note(
        f"{forecast.questions} requests at {settings} take at most {_duration(forecast.seconds)} if "
        "no drive answers, the likely ones first; Ctrl-C stops the scan and keeps the drives found"
    )


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{max(1, round(seconds))} s"
    return f"{round(seconds / 60)} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def _emit(one: Found, line: LineArguments) -> None:
    emit(
        line=line.named_port,
        drive=one.name,
        drive_name=one.name,
        protocol=one.protocol,
        address=one.address,
        sound=one.sound,
        identity=dict(one.identity),
        detail=one.detail,
        settings=str(one.settings or ""),
        model=one.model,
        candidates=list(one.candidates),
    )


def _line(found: Found, *, wide: bool) -> str:
    told = ", ".join(f"{name} {value}" for name, value in found.identity.items())
    remark = "" if found.sound else f"answers, but damaged: {found.detail}"
    several = counted(len(found.candidates), "model")
    fitting = " or ".join(found.candidates) if len(found.candidates) <= _MOST_NAMED else several
    model = f"model {found.model}" if found.model else f"fits {fitting}" if found.candidates else ""
    settings = str(found.settings or "") if wide else ""
    words = (found.name, settings, model, told, remark)
    return "  ".join(word for word in words if word)


def _parts(text: str | None) -> list[str]:
    return [] if text is None else [part.strip() for part in text.split(",")]


def _number(text: str, what: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise UsageError(f"{text!r} is not a {what}; write a number, or several with commas between")
    return int(text)


def _stop_bits(text: str) -> float:
    try:
        return float(text) if "." in text else int(text)
    except ValueError:
        raise UsageError(f"{text!r} is not a number of stop bits; write 1, 1.5 or 2") from None
