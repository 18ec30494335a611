"""Click commands with help in sections, and groups that import a command only when it is called."""

from __future__ import annotations

from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import signals

if TYPE_CHECKING:
    from collections.abc import Mapping

NEGATIVE_NUMBERS = {"ignore_unknown_options": True}
"""Click settings of a command whose arguments may begin with a minus sign."""


class CliCommand(click.Command):
    """Command whose help has a section for each `section` of its options, after the options without a section."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command. All its modules are imported by now, as its words have been parsed."""
        signals.loaded()
        return super().invoke(ctx)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the sections of the help."""
        sections: dict[str, list[tuple[str, str]]] = {"Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
            if record is not None:
                sections.setdefault(getattr(parameter, "section", "Options"), []).append(record)
        for name, records in sections.items():
            with formatter.section(name):
                formatter.write_dl(records)


class LazyCommand(click.Command):
    """Command that is imported when it is called; before that, only its name and a short text are known.

    The lazy group of click's manual imports every command to list them, and to complete a name. This class imports only
    the command that is called. where: `module:function` in this package.
    """

    def __init__(self, name: str, where: str, text: str) -> None:
        super().__init__(name, help=text, short_help=text)
        self._where = where

    @cached_property
    def loaded(self) -> click.Command:
        """The real command, imported on first use."""
        module, _, name = self._where.partition(":")
        command: click.Command = getattr(import_module(f"drivecomm.cli.{module}"), name)
        return command

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Let the real command parse its words."""
        return self.loaded.make_context(info_name, args, parent=parent, **extra)


class LazyGroup(click.Group):
    """Group of lazy commands, listed in the order of their definition.

    otherwise: default command, used if the first word is not a command of the group.
    """

    def __init__(self, *given: Any, otherwise: str = "", **further: Any) -> None:
        super().__init__(*given, **further)
        self._otherwise = otherwise

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command for these words, and the remaining words."""
        if self._otherwise and args[0] not in self.commands:
            args = [self._otherwise, *args]
        return super().resolve_command(ctx, args)

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        return list(self.commands)

    def add_lazy(self, commands: Mapping[str, tuple[str, str]], otherwise: Mapping[str, str]) -> None:
        """Add commands by name: location, empty for a group, and summary. The commands of a group follow it.

        otherwise: default commands, by the name of the group.
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
                    # Options that the group does not know belong to its default command.
                    context_settings={"ignore_unknown_options": name in otherwise},
                )
            )
            if isinstance(into, click.Group):
                into.add_command(made)
