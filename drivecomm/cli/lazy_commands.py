"""Commands that are loaded when they are called, and how they make the values of their arguments and options.

typer has pydantic make them, which takes longer to load than all else that a command needs.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from drivecomm.cli import signals

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_NEGATIVE_NUMBERS = frozenset({"decode", "write", "reference"})
"""Commands whose arguments may begin with a minus."""


class LazyCommand(TyperCommand):
    """A command that is loaded when it is called. where: `module:function` in this package."""

    def __init__(self, name: str, where: str, text: str) -> None:
        super().__init__(name=name, help=text)
        self._where = where

    @cached_property
    def loaded(self) -> Any:
        """The command itself."""
        module, _, name = self._where.partition(":")
        return made(str(self.name), getattr(import_module(f"drivecomm.cli.{module}"), name))

    def make_context(self, info_name: Any, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Let the command itself read its arguments; then it begins."""
        context = self.loaded.make_context(info_name, args, parent=parent, **extra)
        signals.loaded()
        return context


def lazy(commands: Mapping[str, tuple[str, str]]) -> dict[str, LazyCommand | Group]:
    """Return commands by name from where they are and what they do; those of a group have its name before theirs."""
    found: dict[str, LazyCommand | Group] = {}
    for name, (where, text) in commands.items():
        group, _, within = name.rpartition(" ")
        if group:
            found[group].commands[within] = LazyCommand(within, where, text)  # type: ignore[union-attr]
        else:
            found[name] = LazyCommand(name, where, text) if where else Group(
                name=name, help=text, no_args_is_help=True
            )  # fmt: skip
    return found


def made(name: str, function: Callable[..., Any]) -> Any:
    """Return the command of a function."""
    kind = Command
    line = inspect.signature(function).parameters.get("line")
    if line is not None and line.annotation == "LineOptions":
        # Buses and ports are for commands that have a line.
        from drivecomm.cli import line_command  # noqa: PLC0415

        kind, function = line_command.LineCommand, line_command.on_a_line(function)
    application = typer.Typer(add_completion=False)
    settings = {"ignore_unknown_options": True} if name in _NEGATIVE_NUMBERS else None
    text = flowing(inspect.getdoc(function) or "")
    application.command(name, cls=kind, context_settings=settings, help=text)(function)
    return get_command(application)


def flowing(text: str) -> str:
    """Return a text with each paragraph on one line; the terminal breaks it."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


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
            made = make(value)
        except ValueError:
            made = None
        if made is not None and (not choices or made in choices):
            return made
        name = param.get_error_hint().strip("'")
        raise InvalidValue(f"{name} cannot be {value!r}; write {expected}", ctx=ctx, param=param)


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
            vars(parameter)["_runtime_param"] = _PlainValue(kind)
    return parameters
