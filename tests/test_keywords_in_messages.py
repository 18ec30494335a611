"""Errors that mention Python keywords declare them, so that the command line can show its own words instead."""

import ast
import re
from pathlib import Path

import pytest

import drivecomm
from drivecomm.cli.output import in_flags, sentence
from drivecomm.errors import DeadlineError, UsageError
from drivecomm.protocol import installed

_KEYWORD = re.compile(r"\b(?P<name>[a-z][a-z0-9_]*)=[A-Za-z0-9]")
_WITH_WORDS_OF_THEIR_OWN = {"testing", "cli"}


def raised():
    """Yield place, text and declared keywords of every error raised in the code."""
    roots = [
        Path(drivecomm.__file__).parent,
        *(Path(__import__(p.package).__file__).parent for p in installed.values()),
    ]
    for path in sorted(path for root in roots for path in root.rglob("*.py")):
        if _WITH_WORDS_OF_THEIR_OWN.intersection(path.parts):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Raise) or not isinstance(node.exc, ast.Call):
                continue
            # Join the literal parts of an f-string, with a gap for each expression.
            text = "".join(
                each.value for argument in node.exc.args for each in ast.walk(argument)
                if isinstance(each, ast.Constant) and isinstance(each.value, str)
            )  # fmt: skip
            says = [keyword for keyword in node.exc.keywords if keyword.arg == "says"]
            yield f"{path.name}:{node.lineno}", text, says


@pytest.mark.soak
def test_error_that_mentions_a_keyword_declares_it():
    assert not [(place, text) for place, text, says in raised() if _KEYWORD.search(text) and not says]


@pytest.mark.parametrize(
    ("error", "shown"),
    [
        (UsageError("only with store=True", says="store=True"), "only with --store"),
        (UsageError("reply_timeout_s of 0 is none", says="reply_timeout_s"), "--timeout of 0 is none"),
        (UsageError("give maximum_hz=50 to it", says="maximum_hz=50"), "give DRIVE,maximum_hz=50 to it"),
        (UsageError("store=True is in a file"), "store=True is in a file"),
        (
            DeadlineError("the call's time is over"),
            "the call's time is over; give the drive more time with DRIVE,deadline_s=60, or ask for less on this line",
        ),
    ],
)
def test_command_line_replaces_keywords_by_its_own_words(error, shown):
    assert sentence(error) == shown


def test_command_line_names_a_known_drive_in_the_error():
    error = UsageError("give maximum_hz=50 to it", says="maximum_hz=50")
    error.about = {"name": "mill", "drive": "vlt3500:2", "line": "yard"}
    assert sentence(error) == "give mill,maximum_hz=50 to it"


def test_keywords_of_a_causing_error_are_replaced_as_well():
    error = UsageError("plant.toml: only with store=True")
    error.__cause__ = UsageError("only with store=True", says="store=True")
    assert in_flags(str(error), error) == "plant.toml: only with --store"
