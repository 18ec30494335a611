"""Orders as TOML files with drive, master and tasks.

format = 1
drive = "vabus:1,model=agile"
command = ["./mydriver", "--port", "{port}"]

[[task]]
name = "read"
arguments = ["read", "481"]
shows = "(?P<value>[-0-9.]+)"
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.judge.order import JudgeOrder, JudgeTask
from drivecomm.protocol import parse_drive
from drivecomm.tomlfile import CHOICE, LIST, NUMBER, SECONDS, TABLE, TABLES, TEXT, WHOLE, read_toml

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.tomlfile import TomlTable

FORMAT = 1
_KEYS = {
    "format": WHOLE,
    "drive": TEXT,
    "command": LIST,
    "listen": TEXT,
    "limit_s": SECONDS,
    "seed": WHOLE,
    "stored_writes": WHOLE,
    "environment": TABLE,
    "task": TABLES,
}
_TASK_KEYS = {"name": TEXT, "arguments": LIST, "shows": TEXT, "parameter": TEXT, "scale": NUMBER, "goes_on": CHOICE}


def read_order(path: Path) -> JudgeOrder:
    """Return the order in a file. Raises FileFormatError with the line of any mistake."""
    top = read_toml(path, "an order for judge")
    given = top.take(_KEYS, "format", "drive")
    if given.pop("format") != FORMAT:
        raise top.error(f"format is not {FORMAT}, the only one that this version reads", "format")
    tasks = tuple(_task(table) for table in top.tables("task"))
    given.pop("task", None)
    command = _words(top, given.pop("command", []), "command")
    environment = {name: str(value) for name, value in given.pop("environment", {}).items()}
    try:
        drive = parse_drive(given.pop("drive"))
    except UsageError as error:
        raise top.error(str(error), "drive") from error
    try:
        return JudgeOrder(drive=drive, command=command, tasks=tasks, environment=environment, **given)
    except UsageError as error:
        raise top.error(str(error)) from error


def _task(table: TomlTable) -> JudgeTask:
    given: dict[str, Any] = table.take(_TASK_KEYS, "name")
    given["arguments"] = _words(table, given.get("arguments", []), "arguments")
    try:
        return JudgeTask(**given)
    except UsageError as error:
        raise table.error(str(error)) from error


def _words(table: TomlTable, words: list[Any], key: str) -> tuple[str, ...]:
    if not all(isinstance(word, str) for word in words):
        raise table.error(f"{key} is not a list of texts", key)
    return tuple(words)
