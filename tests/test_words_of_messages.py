"""Sentences that name keywords of Python say which, so that the command line can show its own words for them."""

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
    """Yield the texts of all errors that are raised with the place, and what they say that they name."""
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
            # The literal parts of a sentence, with its gaps left open.
            text = "".join(
                each.value for argument in node.exc.args for each in ast.walk(argument)
                if isinstance(each, ast.Constant) and isinstance(each.value, str)
            )  # fmt: skip
            says = [keyword for keyword in node.exc.keywords if keyword.arg == "says"]
            yield f"{path.name}:{node.lineno}", text, says


@pytest.mark.soak
def test_what_names_a_keyword_says_so():
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
def test_the_command_line_has_its_own_words(error, shown):
    assert sentence(error) == shown


def test_a_drive_that_is_known_is_named():
    error = UsageError("give maximum_hz=50 to it", says="maximum_hz=50")
    error.about = {"name": "mill", "drive": "vlt3500:2", "line": "yard"}
    assert sentence(error) == "give mill,maximum_hz=50 to it"


def test_an_error_that_tells_of_another_has_its_words():
    error = UsageError("plant.toml: only with store=True")
    error.__cause__ = UsageError("only with store=True", says="store=True")
    assert in_flags(str(error), error) == "plant.toml: only with --store"
