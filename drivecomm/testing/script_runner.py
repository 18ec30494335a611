"""The script runner: plays an exchange against a list of expectations, without a line or a clock."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias, TypeVar

from drivecomm.errors import ReplyError
from drivecomm.protocol import Ask, Pause

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.protocol import Exchange, Message

T = TypeVar("T")

Step: TypeAlias = "tuple[Message, Message | ReplyError | None]"
"""What the exchange must send next, and what it then gets: a reply, an error thrown in, or None for a `Tell`."""


class ScriptError(AssertionError):
    """The exchange did something other than the script says."""


def play(exchange: Exchange[T], script: Iterable[Step]) -> T:
    """Play an exchange to its end and return its result. Pauses are skipped. Raises ScriptError when it deviates."""
    steps = iter(script)
    try:
        command = next(exchange)
        while True:
            if isinstance(command, Pause):
                command = exchange.send(None)
                continue
            expected = next(steps, None)
            if expected is None:
                raise ScriptError(f"the script is over, and the exchange sends {command.message}")
            request, reply = expected
            if command.message != request:
                raise ScriptError(f"the exchange sends {command.message}, the script says {request}")
            if isinstance(command, Ask) and reply is None:
                raise ScriptError(f"the exchange waits for a reply to {request}, the script has none")
            command = exchange.throw(reply) if isinstance(reply, ReplyError) else exchange.send(reply)
    except StopIteration as finished:
        if (left := next(steps, None)) is not None:
            raise ScriptError(f"the exchange is over, and the script goes on with {left[0]}") from None
        result: T = finished.value
        return result
