"""Commands with help in sections, and groups of commands that are imported when they are called."""

from __future__ import annotations

from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import signals

if TYPE_CHECKING:
    from collections.abc import Mapping

NEGATIVE_NUMBERS = {"ignore_unknown_options": True}
"""Settings of a command whose arguments may begin with a minus."""


class Command(click.Command):
    """A command whose help has a section for each `section` that its options name, after those that name none."""

    def invoke(self, ctx: click.Context) -> Any:
        """Carry it out. Its words have been read, so nothing is being loaded any more."""
        signals.loaded()
        return super().invoke(ctx)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the sections."""
        sections: dict[str, list[tuple[str, str]]] = {"Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
            if record is not None:
                sections.setdefault(getattr(parameter, "section", "Options"), []).append(record)
        for name, records in sections.items():
            with formatter.section(name):
                formatter.write_dl(records)


class LazyCommand(click.Command):
    """A command of which only the name and a short text are known before it is called.

    The lazy group of click's manual imports every command to list them, and to complete a name; this one imports the
    command that is called. where: `module:function` in this package.
    """

    def __init__(self, name: str, where: str, text: str) -> None:
        super().__init__(name, help=text, short_help=text)
        self._where = where

    @cached_property
    def loaded(self) -> click.Command:
        """The command itself."""
        module, _, name = self._where.partition(":")
        command: click.Command = getattr(import_module(f"drivecomm.cli.{module}"), name)
        return command

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Let the command itself read its words."""
        return self.loaded.make_context(info_name, args, parent=parent, **extra)


class LazyGroup(click.Group):
    """A group of lazy commands, listed in the order in which they were given.

    otherwise: the command that is meant where the first word names none of them.
    """

    def __init__(self, *given: Any, otherwise: str = "", **further: Any) -> None:
        super().__init__(*given, **further)
        self._otherwise = otherwise

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that is meant, and its own words."""
        if self._otherwise and args[0] not in self.commands:
            args = [self._otherwise, *args]
        return super().resolve_command(ctx, args)

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Return the names."""
        return list(self.commands)

    def add_lazy(self, commands: Mapping[str, tuple[str, str]], otherwise: Mapping[str, str]) -> None:
        """Add commands by name: where they are, empty for a group, and what they do. Those of a group follow it.

        otherwise: of some groups, the command that is meant where no other one is named.
        """
        for name, (where, text) in commands.items():
            group, _, within = name.rpartition(" ")
            into = self.commands[group] if group else self
            made = (
                LazyCommand(within, where, text)
                if where
                else LazyGroup(
                    within,
                    help=text,
                    short_help=text,
                    no_args_is_help=True,
                    otherwise=otherwise.get(name, ""),
                    # What is no option of the group is one of that command.
                    context_settings={"ignore_unknown_options": name in otherwise},
                )
            )
            if isinstance(into, click.Group):
                into.add_command(made)
