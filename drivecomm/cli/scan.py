"""The scan command: who is on the line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivecomm.bus import LineChoices, scan_plan
from drivecomm.cli.address_lists import addresses_of
from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.output import emit, say
from drivecomm.errors import DriveCommError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.progress import Progress

    from drivecomm.bus import Found
    from drivecomm.commissioning import ScanForecast

_LINE = "Line"


def scan(
    line: LineOptions,
    protocol: Annotated[list[str] | None, typer.Option("--protocol", help="Only these; repeat it for more.")] = None,
    addresses: Annotated[str | None, typer.Option("--addresses", "-a", help="Such as 1-31 or 1,5,7-9.")] = None,
    wide: Annotated[bool, typer.Option("--wide", help="Try other line settings, too, the likely first.")] = False,
    baudrate: Annotated[
        str | None, typer.Option(rich_help_panel=_LINE, help="Bits per second; several to try: 9600,19200.")
    ] = None,
    bytesize: Annotated[str | None, typer.Option(rich_help_panel=_LINE, help="Data bits, 7 or 8; or 7,8.")] = None,
    parity: Annotated[
        str | None, typer.Option(rich_help_panel=_LINE, help="N, E, O, M or S; several to try: E,N.")
    ] = None,
    stopbits: Annotated[str | None, typer.Option(rich_help_panel=_LINE, help="1, 1.5 or 2; or 1,2.")] = None,
    write: Annotated[
        Path | None, typer.Option("--write", metavar="FILE", help="Write what is found into a plant file.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a plant file that is there.")] = False,
) -> int:
    """Find the drives on a line, with telegrams that cannot move a motor. Exit code 1 when there are none.

    A plain scan asks each protocol's drives at the line settings that they usually have. With --wide, or with several
    values for a setting, others are tried, too; that takes long, so it says first how long, and Ctrl-C keeps what was
    found.
    """
    given = LineChoices(
        baudrates=tuple(_number(text, "baud rate") for text in _parts(baudrate)),
        bytesizes=tuple(_number(text, "number of data bits") for text in _parts(bytesize)),
        parities=tuple(text.upper() for text in _parts(parity)),  # type: ignore[misc]
        stopbits=tuple(_stop_bits(text) for text in _parts(stopbits)),
    )
    if force and write is None:
        raise UsageError("--force is for a file that --write names, so that it has no effect; leave it out")
    if line.plant is not None and "port" in line.given:
        line.refuse("the line is that of --port", "plant")
    several = wide or any(len(some) > 1 for some in (given.baudrates, given.bytesizes, given.parities, given.stopbits))
    wanted = addresses_of(addresses) if addresses else None
    if not scan_plan(protocol or None, wanted):
        raise UsageError(f"no drive of these protocols can have the address {addresses}; see drivecomm protocols")
    if write is not None and not force and write.exists():
        from drivecomm.plant import there_already  # noqa: PLC0415 - loaded by those who write a plant

        # Said before the line is asked for minutes.
        raise UsageError(there_already(write))
    asked: dict[str, Any] = {"only": protocol or None, "addresses": wanted, **_settings(given, several=several)}
    if several and line.named_port.startswith("socket://"):
        raise UsageError(
            f"{line.port} carries no line settings, so that others cannot be tried; use rfc2217://, or leave --wide "
            "and lists of settings out"
        )
    if several:
        from drivecomm.commissioning import forecast_scan  # noqa: PLC0415 - a plain scan says nothing before

        _foretell(forecast_scan(**{**line.facts, **asked}), as_json=line.json)
    found: list[Found] = []
    try:
        _carry_out(line, asked, found.append)
    except (DriveCommError, KeyboardInterrupt):
        # By Ctrl-C or because the port was lost; what was found until then is worth having.
        if found:
            _tell(found, line, write, force=force)
        raise
    _tell(found, line, write, force=force)
    return 0 if found else 1


def _tell(found: list[Found], line: LineOptions, write: Path | None, *, force: bool) -> None:
    if write is not None and found:
        from drivecomm.plant import found_text, write_new, write_over  # noqa: PLC0415 - as above

        text = found_text(found, port=line.named_port, echo=line.echo == "expect")
        (write_over if force else write_new)(write, text)
    if not line.json:
        say(f"{len(found)} drive{'' if len(found) == 1 else 's'} found")
        if write is not None:
            say(f"written to {write}" if found else f"{write} is not written")


def _settings(given: LineChoices, *, several: bool) -> dict[str, Any]:
    """Return how a scan is told the settings: those to try, or the one for everybody."""
    if several:
        return {"choices": given}
    one = {
        "baudrate": given.baudrates,
        "bytesize": given.bytesizes,
        "parity": given.parities,
        "stopbits": given.stopbits,
    }
    return {name: some[0] for name, some in one.items() if some}


def _carry_out(line: LineOptions, asked: dict[str, Any], keep: Callable[[Found], None]) -> None:
    # The bar stays out of what a script reads: on a terminal both share it, otherwise the bar goes to standard error.
    on_terminal = sys.stdout.isatty()
    with line.bus() as bus, _progress(shown=not line.json, on_terminal=on_terminal) as progress:
        task = progress.add_task("scanning", total=None)

        def show(name: str, done: int, total: int) -> None:
            progress.update(task, description=f"asking {name}", completed=done, total=total)

        for one in bus.scan(**asked, progress=show):
            keep(one)
            if line.json:
                _emit(one)
            elif on_terminal:
                progress.console.print(_line(one, wide="choices" in asked), highlight=False, markup=False)
            else:
                say(_line(one, wide="choices" in asked))


def _progress(*, shown: bool, on_terminal: bool) -> Progress:
    from rich.console import Console  # noqa: PLC0415 - rich is loaded only where something is drawn
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=not on_terminal, soft_wrap=True)
    return Progress(
        *columns, console=console, transient=True, redirect_stdout=False, disable=not (shown and console.is_terminal)
    )


def _foretell(forecast: ScanForecast, *, as_json: bool) -> None:
    if as_json:
        emit(questions=forecast.questions, settings=forecast.settings, seconds=round(forecast.seconds, 1))
        return
    settings = f"{forecast.settings} line setting{'' if forecast.settings == 1 else 's'}"
    sys.stderr.write(
        f"drivecomm: {forecast.questions} questions at {settings} take {_duration(forecast.seconds)} at most while "
        "nobody answers, the likely first; Ctrl-C ends it and keeps what was found\n"
    )


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{max(1, round(seconds))} s"
    return f"{round(seconds / 60)} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def _emit(one: Found) -> None:
    emit(drive=one.name, protocol=one.protocol, address=one.address, sound=one.sound, identity=dict(one.identity),
         detail=one.detail, settings=str(one.settings or ""), model=one.model)  # fmt: skip


def _line(found: Found, *, wide: bool) -> str:
    told = ", ".join(f"{name} {value}" for name, value in found.identity.items())
    remark = "" if found.sound else f"answers, but damaged: {found.detail}"
    model = f"model {found.model}" if found.model else ""
    settings = str(found.settings or "") if wide else ""
    words = (found.name, settings, model, told, remark)
    return "  ".join(word for word in words if word)


def _parts(text: str | None) -> list[str]:
    return [] if text is None else [part.strip() for part in text.split(",")]


def _number(text: str, what: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise UsageError(f"{text!r} is no {what}; write a number, or several with commas between")
    return int(text)


def _stop_bits(text: str) -> float:
    try:
        return float(text) if "." in text else int(text)
    except ValueError:
        raise UsageError(f"{text!r} is no number of stop bits; write 1, 1.5 or 2") from None
