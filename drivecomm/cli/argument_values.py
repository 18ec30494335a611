"""How commands make the values of their arguments and options.

typer has pydantic make them, which takes longer to load than all else that a command needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import typer
from typer.core import TyperCommand, TyperGroup

if TYPE_CHECKING:
    from collections.abc import Callable

_NUMBERS: dict[Any, tuple[Callable[[Any], Any], str]] = {int: (int, "a whole number"), float: (float, "a number")}


class InvalidValue(typer.BadParameter):
    """A value that an argument cannot have, in one sentence."""

    def format_message(self) -> str:
        """Return the sentence."""
        return self.message


@dataclass(frozen=True, slots=True)
class _PlainValue:
    """Makes the value of one parameter from what was written. kind: its type, or that of each of several."""

    kind: Any

    def coerce(self, value: Any, *, param: Any, ctx: Any) -> Any:
        """Return the value. Raises InvalidValue."""
        several = param.multiple or param.nargs == -1
        if value is None:
            return () if several else None
        return [self._made(each, param, ctx) for each in value] if several else self._made(value, param, ctx)

    def _made(self, value: Any, param: Any, ctx: Any) -> Any:
        if self.kind in (Path, bool):
            return self.kind(value)
        choices = get_args(self.kind)
        make, expected = _NUMBERS.get(self.kind, (str, ""))
        if choices:
            expected = f"{', '.join(choices[:-1])} or {choices[-1]}"
        try:
            made = make(value) if make is str or _is_plain(value) else None
        except ValueError:
            made = None
        if made is not None and (not choices or made in choices):
            return made
        name = param.get_error_hint().replace("'", "")
        raise InvalidValue(f"{name} cannot be {value!r}; write {expected}", ctx=ctx, param=param)


def _is_plain(value: Any) -> bool:
    from drivecomm.protocol import is_plain  # noqa: PLC0415 - the list of commands has no numbers

    return not isinstance(value, str) or is_plain(value)


class Command(TyperCommand):
    """A command whose values are made without pydantic, in versions of typer that use it."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return its parameters."""
        return _with_plain_values(super().get_params(ctx))


class Group(TyperGroup):
    """A group of commands, likewise."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return its parameters."""
        return _with_plain_values(super().get_params(ctx))


def _with_plain_values(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        about = getattr(parameter, "type_descriptor", None)
        if about is not None and not about.is_ranged:
            kind = get_args(about.annotation)[0] if about.is_list else about.annotation
            parameter.get_runtime_param = partial(_PlainValue, kind)
    return parameters
