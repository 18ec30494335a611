"""Reference of the command line, made from the application: usage, arguments, options with defaults, how-tos.

The options that every command on a line has are listed once, in a separate section.
"""

from __future__ import annotations

import re
from collections import Counter
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from markdown_tables import code, table

from drivecomm import errors
from drivecomm.cli.app import app
from drivecomm.cli.entry import COMPLETION

if TYPE_CHECKING:
    from collections.abc import Iterator

DOCS = Path(__file__).parent
SHARED = ("Line", "Plant")
"""Sections of options that many commands share."""
_SHOWN_PAGES = 3
_COMPLETION = (
    ("bash, from 4.4 on", f'eval "$({COMPLETION}=bash_source drivecomm)"', "~/.bashrc"),
    ("zsh", f'eval "$({COMPLETION}=zsh_source drivecomm)"', "~/.zshrc"),
    ("fish", f"{COMPLETION}=fish_source drivecomm | source", "~/.config/fish/completions/drivecomm.fish"),
)
"""Setup of completion for each shell: the file and the line to add."""


def commands_page() -> str:
    """Return the page of all commands as Markdown."""
    commands = dict(all_commands())
    first = next(context for context in commands.values() if _shared(context))
    parts = [
        "# Commands",
        "This page is made from the commands and has the same texts as `drivecomm COMMAND --help`.",
        table(
            ("command", "purpose"), ((f"[`{name}`](#{_anchor(name)})", _help(each)) for name, each in commands.items())
        ),
        "## Exit codes",
        "[Errors and exit codes](errors.md) lists the remedies.",
        table(("code", "meaning"), _exit_codes()),
        "## Completion",
        "Shells complete commands, options, protocols, files, and drives of the plant file. One line turns it on:",
        table(("shell", "line", "file"), ((shell, code(line), code(file)) for shell, line, file in _COMPLETION)),
        "## Options of a line",
        "All commands that talk to drives have these options, except those without effect on them.",
        _parameters(first, "option", _shared(first)),
    ]
    for name, context in commands.items():
        parts += _section(name, context)
    return "\n\n".join(parts) + "\n"


def all_commands() -> Iterator[tuple[str, Any]]:
    """Yield the name of every command, as typed after `drivecomm`, and its context."""
    yield from _below(app, click.Context(app, info_name="drivecomm", **app.context_settings), "")


def _below(group: Any, context: click.Context, prefix: str) -> Iterator[tuple[str, Any]]:
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        # Resolve a command that is loaded on its first call.
        command = getattr(command, "loaded", command)
        inner = click.Context(command, info_name=name, parent=context)
        if hasattr(command, "list_commands"):
            yield from _below(command, inner, f"{prefix}{name} ")
        elif not command.hidden:
            yield f"{prefix}{name}", inner


def _section(name: str, context: Any) -> Iterator[str]:
    command, shared = context.command, _shared(context)
    yield f"## {name} {{ #{_anchor(name)} }}"
    yield _text(cleandoc(command.help))
    yield f"```text\n{context.command_path} {' '.join(command.collect_usage_pieces(context))}\n```"
    for kind in ("argument", "option"):
        own = [one for one in command.params if one.param_type_name == kind and one not in shared]
        if own:
            yield _parameters(context, kind, own)
    if shared:
        idle = ", ".join(code(one.opts[0]) for one in shared if one.hidden)
        yield f"All [options of a line](#options-of-a-line){f', but {idle}' if idle else ''}."
    pages = [f"[{title}]({place})" for place, title in _pages_with(name)]
    if pages:
        yield f"Used in: {', '.join(pages)}."


def _shared(context: Any) -> list[Any]:
    return [one for one in context.command.params if getattr(one, "section", None) in SHARED]


def _parameters(context: Any, kind: str, parameters: list[Any]) -> str:
    records = filter(None, (parameter.get_help_record(context) for parameter in parameters))
    return table((kind, "meaning"), ((code(name), _text(meaning)) for name, meaning in records))


def _help(context: Any) -> str:
    return _text(context.command.get_short_help_str(limit=400))


def _text(text: str) -> str:
    """Return help as Markdown: flags and environment variables become code; nothing else is markup."""
    marks = r"(?P<code>`[^`]*`)|(?<![\w-])(?P<typed>--?[a-z][\w-]*|\$\w+)|(?P<markup>[*_<\[])"
    return re.sub(marks, lambda at: at["code"] or (f"`{at['typed']}`" if at["typed"] else f"\\{at[0]}"), text)


def _exit_codes() -> Iterator[tuple[str, str]]:
    yield "0", "success"
    yield "1", "a check or a step failed, or a search found nothing; the command's section says so"
    told: dict[int, list[str]] = {}
    for kind in errors.DriveCommError.__subclasses__():
        told.setdefault(kind.exit_code, []).append(f"{code(kind.__name__)}: {(kind.__doc__ or '').splitlines()[0]}")
    yield from ((str(number), " ".join(texts)) for number, texts in sorted(told.items()))
    yield "130, 143, 129", "interrupted by Ctrl-C, SIGTERM or SIGHUP"


def _pages_with(name: str) -> list[tuple[str, str]]:
    """Return the address and title of the pages outside the reference that use a command most often in consoles."""
    typed = re.compile(rf"^ *\$ drivecomm {name}(?![\w-])", re.MULTILINE)
    pages = {page: page.read_text(encoding="utf-8") for part in ("tutorial", "how-to", "explanation")
             for page in sorted((DOCS / part).glob("*.md"))}  # fmt: skip
    uses = Counter({page: len(typed.findall(text)) for page, text in pages.items()})
    most = [page for page, count in uses.most_common(_SHOWN_PAGES) if count]
    return [(f"../{page.relative_to(DOCS).as_posix()}", pages[page].partition("\n")[0].lstrip("# ")) for page in most]


def _anchor(name: str) -> str:
    return f"drivecomm-{name.replace(' ', '-')}"
