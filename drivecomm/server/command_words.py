"""Commands as readable text for the log, for events and for the history."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

_UNITS = {"percent": "%", "hz": "Hz", "seconds": "s", "watchdog_s": "s"}
_BARE = frozenset({"parameter", "how", "percent", "hz"})
"""Arguments shown without their name, because the value is clear by itself."""


def command_words(verb: str, arguments: Mapping[str, Any]) -> str:
    """Return a verb with its arguments, such as "set_reference 40.0 %" or "write 3-03, value 40"."""
    # 0 is an argument, and equals False.
    said = {name: value for name, value in arguments.items() if value is not None and value is not False}
    given = [_argument(name, value) for name, value in said.items()]
    return f"{verb} {', '.join(given)}" if given else verb


def _argument(name: str, value: Any) -> str:
    words = name.removesuffix("_s").replace("_", " ")
    if value is True:
        return words
    if isinstance(value, list | tuple):
        value = " ".join(map(str, value))
    shown = f"{value} {_UNITS[name]}" if name in _UNITS else str(value)
    return shown if name in _BARE else f"{words} {shown}"
