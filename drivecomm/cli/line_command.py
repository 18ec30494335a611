"""Commands on a line: made from a function whose argument `line` takes all the options of a line together."""

from __future__ import annotations

import inspect
from copy import copy
from dataclasses import fields
from functools import wraps
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from drivecomm.cli.argument_values import Command
from drivecomm.cli.line_options import WITHOUT_EFFECT, LineOptions
from drivecomm.link import Echo

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

# Modules that must be quick to load import typer for their annotations only.
_TYPER: Mapping[str, Any] = {"typer": typer}


class LineCommand(Command):
    """A command with the line options: lets `--echo` stand alone, as it did before it had a value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Give a lone `--echo` its value."""
        modes = get_args(Echo)
        ends = args.index("--") if "--" in args else len(args)
        given = []
        for place, word in enumerate(args):
            given.append(word)
            if word == "--echo" and place < ends and (place + 1 == len(args) or args[place + 1] not in modes):
                given.append("expect")
        return super().parse_args(ctx, given)


def on_a_line(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the line options; it receives them together as its argument `line`.

    An option that the command has itself, such as one with room for several values, is its own alone.
    """
    hints = get_type_hints(LineOptions, localns=dict(_TYPER), include_extras=True)
    signature = inspect.signature(command, eval_str=True, locals=_TYPER)
    own = [parameter for name, parameter in signature.parameters.items() if name != "line"]
    names = [field.name for field in fields(LineOptions) if field.name != "given"]
    shared = [field for field in fields(LineOptions) if field.name in names and field.name not in signature.parameters]
    idle = WITHOUT_EFFECT.get(command.__name__, {})
    added = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=field.default,
            annotation=_hidden(hints[field.name]) if field.name in idle else hints[field.name],
        )
        for field in shared
    ]

    @wraps(command)
    def with_line(context: typer.Context, **arguments: Any) -> Any:
        given = frozenset(name for name in names if _is_written(context, name))
        line = LineOptions(**{field.name: arguments.pop(field.name) for field in shared}, given=given)
        for name, why in idle.items():
            line.refuse(f"{command.__name__} {why}", name)
        return command(line=line, **arguments)

    context = inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
    parameters = [context, *(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own), *added]
    with_line.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    with_line.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    del with_line.__wrapped__
    return with_line


def _is_written(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _hidden(hint: Any) -> Any:
    """Return the hint of an option that is known to be one, and not offered."""
    option = copy(hint.__metadata__[0])
    option.hidden = True
    return Annotated[hint.__origin__, option]
