"""Order for the judge: a drive, the command line of a master, and the master's tasks."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from drivecomm.errors import UsageError, suggestion

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import DriveConfig

TASKS = ("read", "write", "start", "stop", "reset", "run")
"""Possible tasks of a master; `run` is for one without task arguments that polls a drive, for example."""

PLACEHOLDERS = ("port", "host", "tcp_port", "task", "value")
_PLACEHOLDER = re.compile(r"\{([a-z_]+)\}")

USUAL_VALUE = "10"
"""Value that replaces {value} unless a case sets another one."""

LONGEST_LIMIT_S = 600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgeTask:
    """A task that a master can carry out.

    name: one of `TASKS`. arguments: words after the command. shows: a regular expression for the value that the master
    shows, its group `value` if it has one; learned from an undisturbed run if empty. parameter: the address or name of
    the parameter that is read or written; learned if empty. scale: the displayed number for each unit of the physical
    value; 1, or the raw number, if None. goes_on: whether the master runs until it is ended; observed if None.
    """

    name: str
    arguments: tuple[str, ...] = ()
    shows: str = ""
    parameter: str = ""
    scale: float | None = None
    goes_on: bool | None = None

    def __post_init__(self) -> None:
        if self.name not in TASKS:
            raise UsageError(f"unknown task {self.name!r}; {suggestion(self.name, TASKS, 'use')}")
        if self.scale is not None and not self.scale:
            raise UsageError(f"task {self.name}: a scale of 0 shows nothing; write what is shown for one unit")
        try:
            re.compile(self.shows)
        except re.error as error:
            raise UsageError(f"task {self.name}: shows is not a regular expression: {error}") from None


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgeOrder:
    """A master, and the virtual drive that it is judged with.

    command: the words that start the master, with {port} in place of its port; empty for a master that runs already.
    tasks: the master's tasks; without any, the bare command counts as the task `run`. listen: where the line is served:
    pty, tcp, rfc2217, or an address as for `drivecomm simulate --listen`. limit_s: time limit of one process. seed:
    random seed of all cases. stored_writes: EEPROM writes of one parameter that one task may cause. environment:
    variables for the master in addition to those of this process.
    """

    drive: DriveConfig
    command: tuple[str, ...] = ()
    tasks: tuple[JudgeTask, ...] = ()
    listen: str = "pty"
    limit_s: float = 15.0
    seed: int = 0
    stored_writes: int = 2
    environment: Mapping[str, str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        names = [task.name for task in self.tasks]
        for name in names:
            if names.count(name) > 1:
                raise UsageError(f"the task {name} is given twice; leave one out")
        if not self.tasks:
            object.__setattr__(self, "tasks", (JudgeTask(name="run"),))
        if not 0 < self.limit_s <= LONGEST_LIMIT_S:
            raise UsageError(f"invalid limit of {self.limit_s:g} s; write up to {LONGEST_LIMIT_S:g} seconds")
        if self.stored_writes < 0:
            raise UsageError(f"invalid stored_writes = {self.stored_writes}; write 0 or more")
        for task in self.tasks:
            for word in (*self.command, *task.arguments):
                for name in _PLACEHOLDER.findall(word):
                    if name not in PLACEHOLDERS:
                        raise UsageError(f"unknown placeholder {{{name}}}; {suggestion(name, PLACEHOLDERS, 'use')}")
            words = " ".join((*self.command, *task.arguments))
            if self.command and not any(f"{{{name}}}" in words for name in ("port", "tcp_port")):
                raise UsageError("the command of the master has no port; write {port} where the port belongs")

    def task(self, name: str) -> JudgeTask | None:
        """Return the task with this name, or None."""
        return next((task for task in self.tasks if task.name == name), None)

    def words(self, task: JudgeTask, port: str, value: str = USUAL_VALUE) -> list[str]:
        """Return the command line for a task at a port. value: the replacement of {value}."""
        place = urlsplit(port) if "://" in port else None
        given = {
            "port": port,
            "host": (place.hostname or "") if place else "",
            "tcp_port": str(place.port) if place else "",
            "value": value,
        }
        arguments = [_filled(word, given) for word in task.arguments]
        words: list[str] = []
        for word in self.command:
            words += arguments if word == "{task}" else [_filled(word, given)]
        return words if "{task}" in self.command else words + arguments


def _filled(word: str, given: Mapping[str, str]) -> str:
    return _PLACEHOLDER.sub(lambda found: given.get(found[1], found[0]), word)


def parse_task(text: str, shows: str = "") -> JudgeTask:
    """Parse `read` or `read=read 481`: a task and its arguments, quoted as in a shell. Raises UsageError."""
    name, _, arguments = text.partition("=")
    try:
        words = shlex.split(arguments)
    except ValueError as error:
        raise UsageError(f"the arguments of {text!r} cannot be parsed: {error}") from None
    return JudgeTask(name=name.strip(), arguments=tuple(words), shows=shows)
