"""What is stopped needs no more than to be reached: nothing else that is wrong with it keeps it running."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.cli.drive_names import DriveName, parse_drive, plant_file
from drivecomm.cli.opened_drive import named_in_errors
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.protocol import LINE_FACT_NAMES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from drivecomm.bus import Drive
    from drivecomm.cli.line_options import LineOptions

T = TypeVar("T")


def as_far_as_possible(make: Callable[..., T], options: Mapping[str, Any]) -> tuple[T, str]:
    """Return what is made with these options, or without those that cannot be, and then why.

    A model whose file is missing is not needed for a stop. What raises without any options, too, is raised.
    """
    try:
        return make(**options), ""
    except Exception as error:  # noqa: BLE001 - whatever it is, a motor must still be stopped
        why = str(error)
    facts = {name: value for name, value in options.items() if name in LINE_FACT_NAMES}
    try:
        return make(**facts), f"without its options: {why}"
    except Exception:  # noqa: BLE001 - as above
        return make(), f"without its options: {why}"


@contextmanager
def stoppable_drive(line: LineOptions, text: str, model: str | None) -> Iterator[tuple[Drive, DriveName, str]]:
    """Look a drive up, open its line, and yield it, its name, and what had to be left out; errors then name both."""
    reached, name, broken = reached_for_stopping(line, text)
    options = {**name.options, **({"model": model} if model else {})}
    with reached.bus() as bus:
        drive, without = as_far_as_possible(partial(bus.drive, name.protocol, name.address), options)
        with named_in_errors(name):
            yield drive, name, broken or without


def reached_for_stopping(line: LineOptions, text: str) -> tuple[LineOptions, DriveName, str]:
    """Return the line of a drive, the drive, and what is wrong with the plant file, empty if nothing is.

    --arm is not needed for it, and does no harm.
    """
    line = replace(line, arm=False)
    try:
        return (*line.reaching(text), "")
    except FileFormatError as error:
        file = plant_file(line.plant, port_given=False)
        if file is None:
            raise
        # Only a broken plant file takes the reader of such.
        from drivecomm.plant import salvaged  # noqa: PLC0415

        try:
            plant, _ = salvaged(file)
            drive = plant.drive(text.partition(",")[0])
        except UsageError:
            return *_by_its_address(line, text, error), str(error)
        of = plant.line(drive.line)
        settings = {key: value for key, value in of.settings.items() if getattr(line, key) is None}
        reached = replace(
            line,
            port=line.port_of(of, str(file)),
            echo="expect" if of.echo else line.echo,
            given=line.given | {"port"},
            **settings,
        )
        name = DriveName(
            protocol=drive.protocol,
            address=drive.address,
            options=dict(drive.options),
            name=drive.name,
            line=drive.line,
        )
        return reached, name, str(error)


def _by_its_address(line: LineOptions, text: str, error: FileFormatError) -> tuple[LineOptions, DriveName]:
    """Return line and drive as they are named, without any plant. Raises the error where that does not suffice."""
    if ":" not in text.partition(",")[0] or line.port is None:
        raise error
    return replace(line, given=line.given | {"port"}), replace(parse_drive(text), line=line.port)
