"""Messages from fields by name, as vectors and `drivecomm encode` give them."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError

if TYPE_CHECKING:
    from collections.abc import Mapping


def message_of(kind: type[Any], given: Mapping[str, Any], what: str) -> Any:
    """Return a message made from fields by name.

    kind: the message's dataclass. given: with or without the kind of telegram. what: how a sentence begins that says
    what is wrong with them, such as "a parameter block". Raises TelegramError for a field that is missing, or is none.
    """
    own = {field.name: field for field in fields(kind)}
    content = {name: value for name, value in given.items() if name != "kind" or name in own}
    if unknown := [name for name in content if name not in own]:
        raise TelegramError("field", f"{what} has no field {unknown[0]!r}; it has {', '.join(own)}", field=unknown[0])
    needed = [name for name, field in own.items() if field.default is MISSING and field.default_factory is MISSING]
    if missing := [name for name in needed if name not in content]:
        others = ", ".join(name for name in own if name not in needed)
        may = f"; it may also have {others}" if others else ""
        raise TelegramError("field", f"{what} also needs {', '.join(missing)}{may}", field=missing[0])
    return kind(**content)
