"""Stop of one drive, or of all drives of a protocol; no unrelated error keeps a motor running."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.bus import make_despite_errors
from drivecomm.cli.drive_names import plant_file
from drivecomm.cli.line_options import naming
from drivecomm.cli.output import labels, tell
from drivecomm.cli.stop.safe_lookups import SafeLookups
from drivecomm.cli.stop.stop_ways import StopWays
from drivecomm.errors import FileFormatError, UsageError, WrongDriveError
from drivecomm.protocol import DriveConfig, commanded_by_model, parse_drive

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from contextlib import AbstractContextManager
    from pathlib import Path

    from drivecomm.bus import Bus
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.client import Registration
    from drivecomm.protocol import Stop


def stop_one(line: LineArguments, drive: str, model: str | None, how: Stop) -> int:
    """Stop a drive, a group, or with PROTOCOL:* all drives of a protocol, and print it; return the exit code.

    A program that has the port sends the stop. Raises the error of the drive or its line.
    """
    spite = SafeLookups(as_json=line.json)
    chosen = {"model": model} if model else {}
    protocol, colon, address = drive.partition(":")
    if colon and address == "*":
        _stop_all_of(line, protocol, chosen, how, spite)
        return 0
    try:
        reached, name, broken = reached_for_stopping(line, drive, spite)
    except Exception as error:  # noqa: BLE001 - raised again below if no server knows the drive
        return _stop_otherwise(line, drive, model, how, spite, failure=error)
    options = {**name.options, **chosen}
    ways = StopWays(reached.named_port, spite)
    without, wrong = "", None
    with reached.named_in_errors(), naming(name):
        by = ways.stopped_by(str(name), how, partial(_options_for, line, options, spite))
    if by is None:
        with ways.itself(*openings(reached)) as bus:
            one, without = make_despite_errors(partial(bus.drive, name.protocol, name.address), options)
            with naming(name):
                one.stop(how)
            if commanded_by_model(name.protocol):
                from drivecomm.bus import carry_out, checking_right_drive

                try:
                    carry_out(None, checking_right_drive(one))
                except WrongDriveError as error:
                    wrong = error
    _tell(name, how, by, as_json=line.json)
    if broken or without:
        spite.note(broken or without)
    if wrong is not None:
        raise wrong
    return 0


def _stop_otherwise(
    line: LineArguments, text: str, model: str | None, how: Stop, spite: SafeLookups, *, failure: Exception
) -> int:
    """Stop a name that is not a drive of the plant file: a group, or a drive that only the server knows.

    Raises failure if the name is neither.
    """
    # Imported late, because only names outside the plant file need it.
    from drivecomm.cli.stop.groups import group_to_stop
    from drivecomm.cli.stop.server_drives import ServerDrives

    servers = ServerDrives(line, spite)
    if (group := group_to_stop(line, text, servers, spite)) is not None:
        from drivecomm.cli.stop.several import stop_placed

        return stop_placed(line, [group], model, how, spite)
    if (known := servers.named(text)) is None:
        raise failure
    (drive,) = known.drives
    _stop_by_name(known.server, drive, {**line.said_facts, **({"model": model} if model else {})}, how)
    _tell(drive, how, as_json=line.json)
    spite.note(failure)
    return 0


def _stop_all_of(line: LineArguments, protocol: str, options: Mapping[str, Any], how: Stop, spite: SafeLookups) -> None:
    everybody = f"{protocol}:*"
    ways = StopWays(line.named_port, spite)
    with line.named_in_errors():
        by = ways.stopped_by(everybody, how, partial(_options_for, line, {**line.said_facts, **options}, spite))
    if by is None:
        with ways.itself(*openings(line)) as bus:
            all_of_them, _ = make_despite_errors(partial(bus.broadcast, protocol), options)
            all_of_them.stop(how)
    done = f"stop ({how.value}) sent to all; no drive confirms a broadcast"
    with suppress(Exception):
        text = f"{everybody}  {done}{_by(by)}"
        tell(text, as_json=line.json, drive=everybody, drive_name=everybody, done=done, **_by_content(by))


def _tell(name: DriveConfig, how: Stop, by: Registration | None = None, *, as_json: bool) -> None:
    done = f"stop ({how.value}) commanded"
    # A failed output must not keep other motors running.
    with suppress(Exception):
        text = f"{name.name}  {done}{_by(by)}"
        tell(text, as_json=as_json, **labels(name), done=done, result=None, **_by_content(by))


def _by(program: Registration | None) -> str:
    """Return the program that sent the stop, as text; empty for a server, which is the normal case."""
    return "" if program is None or program.plant else f", by {program}"


def _by_content(program: Registration | None) -> dict[str, str]:
    return {} if program is None or program.plant else {"by": str(program)}


def _options_for(
    line: LineArguments, options: Mapping[str, Any], spite: SafeLookups, program: Registration
) -> Mapping[str, Any]:
    """Return the drive options for another program: only those of the command line for its own server, else all."""
    path = the_plant_file(line, spite)
    own = path is not None and program.plant and spite.of(lambda: _is_same(path, program.plant), False, str(path))
    told = line.said_facts if own else dict(options)
    if str(told.get("model", "")).endswith(".toml"):
        import os

        # The program may run in another folder.
        told["model"] = os.path.abspath(str(told["model"]))  # noqa: PTH100
    return told


def _is_same(path: Path, other: str) -> bool:
    return str(path.resolve()) == other


def openings(line: LineArguments) -> list[Callable[[], AbstractContextManager[Bus]]]:
    """Return functions that open a line's own port: with its recording, and without as a fallback."""
    recorded = [line.own_bus] if line.record is not None else []
    return [*recorded, replace(line, record=None).own_bus]


def the_plant_file(line: LineArguments, spite: SafeLookups) -> Path | None:
    """Return the plant file of a call, None also if the folder cannot be read."""
    return spite.of(lambda: plant_file(line.plant, port_given=False), None, "the plant file was not found")


def _stop_by_name(server: Registration, drive: DriveConfig, said: Mapping[str, Any], how: Stop) -> None:
    from drivecomm.client import place_of_name, request_stop

    with naming(drive):
        request_stop(server, place_of_name(drive.name), how, said)


def reached_for_stopping(line: LineArguments, text: str, spite: SafeLookups) -> tuple[LineArguments, DriveConfig, str]:
    """Return the line of a drive, the drive, and the fault of the plant file, empty without a fault.

    A stop needs no --arm, and accepts it. Raises UsageError, also if a damaged plant file does not contain the drive.
    """
    line = replace(line, arm=False)
    try:
        return (*line.reaching(text), "")
    except UsageError as error:
        if not isinstance(error, FileFormatError):
            raise
        failure: Exception = error
    except Exception as error:  # noqa: BLE001 - the drive may be found despite a faulty plant file
        failure = error
    word = text.partition(",")[0]
    if (file := the_plant_file(line, spite)) is not None:
        # Imported late, because only a damaged plant file needs it.
        with suppress(Exception):
            from drivecomm.plant import salvaged

            plant, _ = salvaged(file)
            # A group of the same name makes the meaning unclear, so both are stopped.
            if word not in plant.groups:
                drive = plant.drive(word)
                return line.on(plant.line(drive.line), str(file)), drive, str(failure)
    if ":" not in word or line.port is None:
        raise failure
    return replace(line, given=line.given | {"port"}), replace(parse_drive(text), line=line.port), str(failure)
