"""Stopping one drive, or all of a protocol: nothing that is wrong besides keeps a motor running."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.bus import as_far_as_possible
from drivecomm.cli.drive_names import plant_file
from drivecomm.cli.line_options import naming
from drivecomm.cli.output import labels, tell
from drivecomm.cli.stop.in_spite import InSpite
from drivecomm.cli.stop.ways import Ways
from drivecomm.client import server_of_plant, servers
from drivecomm.errors import FileFormatError, UsageError, WrongDriveError
from drivecomm.protocol import DriveConfig, commanded_by_model, parse_drive

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from contextlib import AbstractContextManager
    from pathlib import Path

    from drivecomm.bus import Bus
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.client import Registration
    from drivecomm.protocol import Stop


def stop_one(line: LineOptions, drive: str, model: str | None, how: Stop) -> None:
    """Stop a drive, or with PROTOCOL:* all of a protocol, and say so.

    The program that has the port does it where there is one. Raises the error that the drive or its line answered with.
    """
    spite = InSpite(as_json=line.json)
    chosen = {"model": model} if model else {}
    protocol, colon, address = drive.partition(":")
    if colon and address == "*":
        _stop_all_of(line, protocol, chosen, how, spite)
        return
    try:
        reached, name, broken = reached_for_stopping(line, drive, spite)
    except Exception as error:
        # Its server knows it all the same.
        known = known_to_a_server(line, drive, spite)
        if known is None:
            raise
        _stop_by_name(*known, {**line.said_facts, **chosen}, how)
        _tell(known[1], how, as_json=line.json)
        spite.note(error)
        return
    options = {**name.options, **chosen}
    ways = Ways(reached.named_port, spite)
    without, wrong = "", None
    with reached.named_in_errors(), naming(name):
        by = ways.stopped_by(str(name), how, partial(_options_for, line, options, spite))
    if by is None:
        with ways.itself(*openings(reached)) as bus:
            one, without = as_far_as_possible(partial(bus.drive, name.protocol, name.address), options)
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


def _stop_all_of(line: LineOptions, protocol: str, options: Mapping[str, Any], how: Stop, spite: InSpite) -> None:
    everybody = f"{protocol}:*"
    ways = Ways(line.named_port, spite)
    with line.named_in_errors():
        by = ways.stopped_by(everybody, how, partial(_options_for, line, {**line.said_facts, **options}, spite))
    if by is None:
        with ways.itself(*openings(line)) as bus:
            all_of_them, _ = as_far_as_possible(partial(bus.broadcast, protocol), options)
            all_of_them.stop(how)
    done = f"stop ({how.value}) sent to all; nobody confirms a broadcast"
    with suppress(Exception):
        text = f"{everybody}  {done}{_by(by)}"
        tell(text, as_json=line.json, drive=everybody, drive_name=everybody, done=done, **_by_content(by))


def _tell(name: DriveConfig, how: Stop, by: Registration | None = None, *, as_json: bool) -> None:
    done = f"stop ({how.value}) commanded"
    # Nobody who cannot be told keeps other motors running.
    with suppress(Exception):
        text = f"{name.name}  {done}{_by(by)}"
        tell(text, as_json=as_json, **labels(name), done=done, result=None, **_by_content(by))


def _by(program: Registration | None) -> str:
    """Return who has done it; that a server does is the rule."""
    return "" if program is None or program.plant else f", by {program}"


def _by_content(program: Registration | None) -> dict[str, str]:
    return {} if program is None or program.plant else {"by": str(program)}


def _options_for(
    line: LineOptions, options: Mapping[str, Any], spite: InSpite, program: Registration
) -> Mapping[str, Any]:
    """Return what another program is told of a drive: its own server what was said here only, any other all of it."""
    path = the_plant_file(line, spite)
    own = path is not None and program.plant and spite.of(lambda: _is_same(path, program.plant), False, str(path))
    told = line.said_facts if own else dict(options)
    if str(told.get("model", "")).endswith(".toml"):
        import os

        # It may have been started in another folder.
        told["model"] = os.path.abspath(str(told["model"]))  # noqa: PTH100
    return told


def _is_same(path: Path, other: str) -> bool:
    return str(path.resolve()) == other


def openings(line: LineOptions) -> list[Callable[[], AbstractContextManager[Bus]]]:
    """Return what opens a line's own port: with its recording, and where that cannot be, without."""
    recorded = [line.own_bus] if line.record is not None else []
    return [*recorded, replace(line, record=None).own_bus]


def the_plant_file(line: LineOptions, spite: InSpite) -> Path | None:
    """Return the plant file of a call, None also where that cannot be seen."""
    return spite.of(lambda: plant_file(line.plant, port_given=False), None, "the plant file is not looked for")


def known_to_a_server(line: LineOptions, text: str, spite: InSpite) -> tuple[Registration, DriveConfig] | None:
    """Return the server that knows a drive to which no plant file leads, and the drive; None where none knows it.

    Raises UsageError where several servers know one of this name.
    """
    from drivecomm.client import drives_known_to

    word = text.partition(",")[0]
    found: dict[str, tuple[Registration, DriveConfig]] = {}
    for server in _servers_of(line, spite):
        nothing: list[dict[str, Any]] = []
        known = spite.of(partial(drives_known_to, server), nothing, f"{server} does not say which drives it has")
        for each in known:
            if word in (each["name"], each["drive"]):
                drive = replace(parse_drive(each["drive"]), name=each["name"], line=each["line"])
                found[f"{server.plant}: {drive.name}"] = server, drive
    if len(found) > 1:
        raise UsageError(f"several servers have a drive {word}: {', '.join(found)}; name its plant with --plant")
    return next(iter(found.values()), None)


def _stop_by_name(server: Registration, drive: DriveConfig, said: Mapping[str, Any], how: Stop) -> None:
    from drivecomm.client import have_stopped, place_of_name

    with naming(drive):
        have_stopped(server, place_of_name(drive.name), how, said)


def _servers_of(line: LineOptions, spite: InSpite) -> list[Registration]:
    """Return the server of the plant file that is named, or all, that of the usual file first, where none is."""
    path = the_plant_file(line, spite)
    own = None if path is None else spite.of(partial(server_of_plant, path), None, "its server is not looked for")
    if "plant" in line.given:
        return [] if own is None else [own]
    if own is not None:
        return [own]
    return spite.of(lambda: list(servers()), [], "servers cannot be looked for")


def reached_for_stopping(line: LineOptions, text: str, spite: InSpite) -> tuple[LineOptions, DriveConfig, str]:
    """Return the line of a drive, the drive, and what is wrong with the plant file, empty if nothing is.

    --arm is not needed for it, and does no harm. Raises UsageError, also for a plant file in which it is not found.
    """
    line = replace(line, arm=False)
    try:
        return (*line.reaching(text), "")
    except UsageError as error:
        if not isinstance(error, FileFormatError):
            raise
        failure: Exception = error
    except Exception as error:  # noqa: BLE001 - whatever is wrong with the plant file, the drive may be found
        failure = error
    word = text.partition(",")[0]
    if (file := the_plant_file(line, spite)) is not None:
        # Only a broken plant file takes the reader of such.
        with suppress(Exception):
            from drivecomm.plant import salvaged

            plant, _ = salvaged(file)
            drive = plant.drive(word)
            return line.on(plant.line(drive.line), str(file)), drive, str(failure)
    if ":" not in word or line.port is None:
        raise failure
    return replace(line, given=line.given | {"port"}), replace(parse_drive(text), line=line.port), str(failure)
