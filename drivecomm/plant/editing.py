"""Edits in a plant file that keep everything else as people wrote it, comments included."""

from __future__ import annotations

import re
from copy import deepcopy
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError
from drivecomm.tomlfile import parse_toml, read_text_file, toml_line, toml_value, write_atomically

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_HEADER = re.compile(r"\s*\[")
_DRIVE = re.compile(r"\s*\[\[\s*drive\s*\]\]")
_TABLE = re.compile(r"\s*\[\s*drive\s*\.\s*options\s*\]")
_DOTTED = re.compile(r"\s*options\s*\.")
_INLINE = re.compile(r"(\s*options\s*=\s*\{)(.*)(\}\s*(?:#[^}]*)?)$", re.DOTALL)
_LINE_KEY = re.compile(r"\s*line\s*=")
_WHAT = "a plant"


def write_options(file: Path, number: int, options: Mapping[str, Any]) -> None:
    """Set options of a drive in a plant file. number: position of the drive in the file, from 0.

    Raises FileFormatError for a file that cannot be read or written, or whose notation this function cannot edit.
    """
    text = read_text_file(file, _WHAT)
    content = parse_toml(text, f"{file}: cannot be read as {_WHAT}")
    wanted = deepcopy(content)
    wanted["drive"][number].setdefault("options", {}).update(options)
    changed = _changed(text, number, options)
    try:
        done = parse_toml(changed, str(file)) == wanted
    except FileFormatError:
        done = False
    if not done:
        lines = ", ".join(toml_line(key, value) for key, value in options.items())
        raise FileFormatError(f"{file}: the options of drive {number + 1} cannot be changed; write there: {lines}")
    write_atomically(file, changed)


def with_line_named(text: str, line: str) -> str:
    """Return the text of a single-line plant with the line named in each [[drive]].

    A plant of several lines needs these names.
    """
    lines = text.split("\n")
    for begin in reversed([place for place, each in enumerate(lines) if _DRIVE.match(each)]):
        end = _next_header(lines, begin + 1)
        if not any(_LINE_KEY.match(each) for each in lines[begin + 1 : end]):
            ending = "\r" if lines[begin].endswith("\r") else ""
            lines.insert(_behind_drive(lines, begin + 1, end), f"{toml_line('line', line)}{ending}")
    return "\n".join(lines)


def _changed(text: str, number: int, options: Mapping[str, Any]) -> str:
    lines = text.split("\n")
    drives = [place for place, line in enumerate(lines) if _DRIVE.match(line)]
    if len(drives) <= number:
        return text
    begin = drives[number] + 1
    end = _next_header(lines, begin)
    while end < len(lines) and not _DRIVE.match(lines[end]):
        if _TABLE.match(lines[end]):
            return _with_keys(lines, end + 1, _next_header(lines, end + 1), "", options)
        end = _next_header(lines, end + 1)
    end = _next_header(lines, begin)
    for place in range(begin, end):
        if inline := _INLINE.match(lines[place]):
            lines[place] = f"{inline[1]}{_inside(inline[2], options)}{inline[3]}"
            return "\n".join(lines)
    for place in range(begin, end):
        if _DOTTED.match(lines[place]):
            return _with_keys(lines, place, end, "options.", options)
    ending = "\r" if lines[begin - 1].endswith("\r") else ""
    lines.insert(_behind_drive(lines, begin, end), f"options = {toml_value(dict(options))}{ending}")
    return "\n".join(lines)


def _inside(text: str, options: Mapping[str, Any]) -> str:
    """Return the text between the braces of an inline table with these options."""
    for key, value in options.items():
        line = toml_line(key, value)
        text, found = re.subn(rf"(?<![\w.-]){re.escape(key)}\s*=\s*[^,}}\s]+", line, text)
        if not found:
            begun = text.rstrip()
            text = f"{begun}, {line} " if begun else f" {line} "
    return text


def _with_keys(lines: list[str], begin: int, end: int, before: str, options: Mapping[str, Any]) -> str:
    """Set options that are written on separate lines."""
    for key, value in options.items():
        ending = "\r" if lines[begin - 1].endswith("\r") else ""
        own = re.compile(rf"(\s*{re.escape(before)}{re.escape(key)}\s*=\s*)[^\s#]+")
        place = next((place for place in range(begin, end) if own.match(lines[place])), None)
        if place is None:
            lines.insert(begin, f"{before}{toml_line(key, value)}{ending}")
            end += 1
        else:
            lines[place] = own.sub(rf"\g<1>{toml_value(value)}", lines[place], count=1)
    return "\n".join(lines)


def _behind_drive(lines: list[str], begin: int, end: int) -> int:
    """Return the position of a new key: after the key `drive`."""
    return next((place + 1 for place in range(begin, end) if re.match(r"\s*drive\s*=", lines[place])), begin)


def _next_header(lines: list[str], begin: int) -> int:
    return next((place for place in range(begin, len(lines)) if _HEADER.match(lines[place])), len(lines))
