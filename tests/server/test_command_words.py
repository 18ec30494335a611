"""Commands as readable text in the log, in events and in the history."""

from decimal import Decimal

import pytest

from drivecomm.server import command_words


@pytest.mark.parametrize(
    ("verb", "arguments", "words"),
    [
        ("reset", {}, "reset"),
        ("set_reference", {"percent": None, "hz": Decimal(30)}, "set_reference 30 Hz"),
        ("set_reference", {"percent": Decimal("40.0")}, "set_reference 40.0 %"),
        ("keep", {"policy": "ramp", "watchdog_s": 5, "reverse": False}, "keep policy ramp, watchdog 5 s"),
        ("keep", {"policy": "hold", "percent": 50, "reverse": True}, "keep policy hold, 50 %, reverse"),
        ("write", {"parameter": "3-03", "value": 0, "store": True}, "write 3-03, value 0, store"),
        ("read", {"parameters": ["480", "481"]}, "read parameters 480 481"),
    ],
)
def test_command_text_contains_no_python_syntax(verb, arguments, words):
    assert command_words(verb, arguments) == words
