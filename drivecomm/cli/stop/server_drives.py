"""Drives and groups that servers know, for stops of names that no plant file has."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from drivecomm.cli.stop.one_drive import the_plant_file
from drivecomm.client import drives_known_to, server_of_plant, servers
from drivecomm.errors import UsageError
from drivecomm.protocol import DriveConfig, parse_drive

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.cli.line_options import LineArguments
    from drivecomm.cli.stop.groups import Place
    from drivecomm.cli.stop.safe_lookups import SafeLookups
    from drivecomm.client import Registration


@dataclass(frozen=True, slots=True, kw_only=True)
class ServedDrives:
    """Drives of a server that a word names. drives: all drives of a group, or one drive."""

    server: Registration
    drives: tuple[DriveConfig, ...]
    is_group: bool

    def places(self, line: LineArguments) -> list[Place]:
        """Return the places of the drives: port, options for opening it, and drive."""
        ports = self.server.lines
        return [(ports[each.line], line.opening, replace(each, options=line.said_facts)) for each in self.drives]


class ServerDrives:
    """Drives of the server of the given plant file, or of all servers; they are requested only once."""

    def __init__(self, line: LineArguments, spite: SafeLookups) -> None:
        self._line, self._spite = line, spite

    def named(self, text: str) -> ServedDrives | None:
        """Return the drives that a word names at the server that knows it; None if no server does.

        Raises UsageError if several servers know the word.
        """
        word = text.partition(",")[0]
        found: dict[str, ServedDrives] = {}
        for server, told in self._drives:
            drive = replace(parse_drive(told["drive"]), name=told["name"], line=told["line"])
            if word in (drive.name, str(drive)):
                found[f"{server.plant}: {drive.name}"] = ServedDrives(server=server, drives=(drive,), is_group=False)
            # A server of an earlier version reports no groups.
            elif word in told.get("groups", ()):
                group = f"{server.plant}: group {word}"
                before = found[group].drives if group in found else ()
                found[group] = ServedDrives(server=server, drives=(*before, drive), is_group=True)
        if len(found) > 1:
            raise UsageError(f"several servers know {word}: {', '.join(found)}; name its plant with --plant")
        return next(iter(found.values()), None)

    @cached_property
    def _drives(self) -> list[tuple[Registration, Mapping[str, Any]]]:
        found: list[tuple[Registration, Mapping[str, Any]]] = []
        for server in self._servers():
            nothing: list[dict[str, Any]] = []
            about = f"{server} does not say which drives it has"
            found += [(server, each) for each in self._spite.of(partial(drives_known_to, server), nothing, about)]
        return found

    def _servers(self) -> list[Registration]:
        """Return the server of the plant file; without one, all servers unless the user named a plant file."""
        path, spite = the_plant_file(self._line, self._spite), self._spite
        own = None if path is None else spite.of(partial(server_of_plant, path), None, "its server was not found")
        if own is not None:
            return [own]
        if "plant" in self._line.given:
            return []
        return spite.of(lambda: list(servers()), [], "servers cannot be found")
