"""The stop command. It imports typer for its annotations only: `stop --all` is quicker without it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from drivecomm.cli.drive_names import plant_file
from drivecomm.cli.line_options import LineOptions
from drivecomm.errors import UsageError, meant
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    import typer


def stop(
    line: LineOptions,
    drive: Annotated[
        str | None,
        typer.Argument(metavar="DRIVE", help="PROTOCOL:ADDRESS, a name from the plant file, or PROTOCOL:* for all."),
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Stop everything that is on the line or in the plant.")
    ] = False,
    how: Annotated[str, typer.Option("--how", help="ramp, coast, quick or dc_brake.")] = "ramp",
    model: Annotated[str | None, typer.Option("--model", "-m", help="Model name, or a .toml file.")] = None,
) -> int:
    """Stop the motor. The address `*` stops all drives of the protocol at once; a broadcast is not confirmed.

    --all works on all lines at the same time: it broadcasts a stop for each protocol and then stops each drive of the
    plant individually, so that it confirms. Exit code 5 unless every drive has confirmed; without a plant file none
    can. Drives that are not armed in the plant file are stopped too.
    """
    chosen = _kind_of_stop(how)
    if not everything:
        if drive is None:
            raise UsageError("no drive given; write PROTOCOL:ADDRESS, or --all to stop everything")
        # Kept apart, because nothing of it must be loaded to stop everything, nor the other way round.
        from drivecomm.cli.stop.one_drive import stop_one  # noqa: PLC0415

        stop_one(line, drive, model, chosen)
        return 0
    if drive is not None:
        raise UsageError(f"--all stops everything; leave {drive} out, or leave --all out")
    from drivecomm.cli.stop.everything import Everything, stop_all  # noqa: PLC0415 - as above

    file = plant_file(line.plant, port_given=line.port is not None)
    return stop_all(Everything(port=line.port, plant=file, how=chosen, opening=line.opening), as_json=line.json)


def _kind_of_stop(how: str) -> Stop:
    try:
        return Stop(how.lower().replace("-", "_"))
    except ValueError:
        known = meant(how, [stop.value for stop in Stop], "use one of")
        raise UsageError(f"unknown kind of stop {how!r}; {known}") from None
