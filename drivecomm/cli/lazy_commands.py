"""Commands that are loaded when they are called, and of which only names and short texts are known before."""

from __future__ import annotations

import inspect
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperCommand
from typer.main import get_command

from drivecomm.cli import signals
from drivecomm.cli.argument_values import Command, Group

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_NEGATIVE_NUMBERS = frozenset({"decode", "write", "reference", "set"})
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
