"""Types of command arguments and options, which refuse an invalid value with one sentence."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

if TYPE_CHECKING:
    from collections.abc import Callable


class InvalidValue(click.BadParameter):
    """Invalid value of an argument, with one sentence as the message."""

    def format_message(self) -> str:
        """Return the message."""
        return self.message


def _refuse(value: Any, expected: str, param: click.Parameter | None, ctx: click.Context | None) -> NoReturn:
    name = param.get_error_hint(ctx).replace("'", "") if param else "this"
    raise InvalidValue(f"invalid {name} {value!r}; write {expected}", ctx=ctx, param=param)


class Number(click.ParamType[Any]):
    """Number in plain digits, without Python's own notations. kind: type of the number."""

    name = "number"

    def __init__(self, kind: Callable[[Any], Any], expected: str, *, at_least: int | None = None) -> None:
        self._kind, self._least = kind, at_least
        self._expected = expected if at_least is None else f"{expected}, {at_least} or more"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Parse a number. Raises InvalidValue."""
        # Imported late, because the list of commands needs no numbers.
        from drivecomm.protocol import is_plain

        made = None
        if not isinstance(value, str) or is_plain(value):
            with suppress(ValueError):
                made = self._kind(value)
        if made is None or (self._least is not None and made < self._least):
            _refuse(value, self._expected, param, ctx)
        return made


class OneOf(click.Choice[str]):
    """One of several words."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Check a word against the choices, and return it. Raises InvalidValue."""
        if value not in self.choices:
            *others, last = self.choices
            _refuse(value, f"{', '.join(others)} or {last}", param, ctx)
        return str(value)


WHOLE_NUMBER = Number(int, "a whole number")
NUMBER = Number(float, "a number")

FILE = click.Path(readable=False, path_type=Path)
"""Path of a file; the code that opens the file checks its existence and permissions."""

FILE.name = "file"
