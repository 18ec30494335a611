"""TOML files of the user's, read in one way: UTF-8 with or without a byte order mark, whatever ends the lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError

if TYPE_CHECKING:
    from collections.abc import Callable
    from importlib.resources.abc import Traversable
    from pathlib import Path


def read_text_file(path: Path | Traversable, what: str, *, shown: str = "") -> str:
    """Return the text of a file. Raises FileFormatError where there is none, or it is no text.

    what: what it is read as, such as "a plant". shown: what errors call it; its path unless given.
    """
    name = shown or str(path)
    try:
        return path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise FileFormatError(no_such_file(name)) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else ""
        raise FileFormatError(f"{name}: cannot be read as {what}: {reason or error}") from error


def read_toml(
    path: Path | Traversable, what: str, *, shown: str = "", parse_float: Callable[[str], Any] = float
) -> tuple[str, dict[str, Any]]:
    """Return the text of a TOML file, and what it says. Raises FileFormatError as `read_text_file` does."""
    text = read_text_file(path, what, shown=shown)
    return text, parse_toml(text, f"{shown or path}: cannot be read as {what}", parse_float=parse_float)


def parse_toml(text: str, refusal: str, *, parse_float: Callable[[str], Any] = float) -> dict[str, Any]:
    """Return what a TOML text says. Raises FileFormatError, which begins with the refusal, for one that is none."""
    import tomllib  # noqa: PLC0415 - loaded with the first file, not with drivecomm

    try:
        return tomllib.loads(text, parse_float=parse_float)
    except (ValueError, ArithmeticError, RecursionError) as error:
        raise FileFormatError(f"{refusal}: {error}") from error


def no_such_file(name: object) -> str:
    """Return the sentence for a file that is not there."""
    return f"{name}: there is no such file"
