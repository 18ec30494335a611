"""The scan command: who is on the line."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from drivecomm.cli.address_lists import addresses_of
from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.output import emit, say

if TYPE_CHECKING:
    from drivecomm.scanning import Found


def scan(
    line: LineOptions,
    protocol: Annotated[list[str] | None, typer.Option("--protocol", help="Only these; repeat it for more.")] = None,
    addresses: Annotated[str | None, typer.Option("--addresses", "-a", help="Such as 1-31 or 1,5,7-9.")] = None,
) -> int:
    """Find the drives on a line, with telegrams that cannot move a motor. Exit code 1 when there are none."""
    from rich.console import Console  # noqa: PLC0415 - rich is loaded only where something is drawn
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    wanted = addresses_of(addresses) if addresses else None
    found: list[Found] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    # The bar stays out of what a script reads: on a terminal both share it, otherwise the bar goes to standard error.
    on_terminal = sys.stdout.isatty()
    console = Console(stderr=not on_terminal, soft_wrap=True)
    drawing = Progress(*columns, console=console, transient=True, redirect_stdout=False, disable=line.json)
    with line.bus() as bus, drawing as progress:
        task = progress.add_task("scanning", total=None)

        def show(name: str, done: int, total: int) -> None:
            progress.update(task, description=f"asking {name}", completed=done, total=total)

        for one in bus.scan(protocol or None, wanted, progress=show):
            found.append(one)
            if line.json:
                emit(drive=one.name, protocol=one.protocol, address=one.address, sound=one.sound,
                     identity=dict(one.identity), detail=one.detail)  # fmt: skip
            elif on_terminal:
                progress.console.print(_line(one), highlight=False, markup=False)
            else:
                say(_line(one))
    if not line.json:
        say(f"{len(found)} drive{'' if len(found) == 1 else 's'} found")
    return 0 if found else 1


def _line(found: Found) -> str:
    told = ", ".join(f"{name} {value}" for name, value in found.identity.items())
    remark = "" if found.sound else f"answers, but damaged: {found.detail}"
    return f"{found.name}  {told}{remark}"
