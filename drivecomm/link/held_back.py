"""What is not sent now, because a late reply to an earlier question could be taken for its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.errors import ReplyError

if TYPE_CHECKING:
    from drivecomm.protocol import Ask, Exchange, Pause, Tell

T = TypeVar("T")


class HeldBack(Exception):  # noqa: N818 - no failure: nothing was sent, and whoever called goes on later
    """A question cannot be told from an earlier one whose reply may still come; others may have the line until then.

    until: when it can be asked. exchange: what is to be carried out then.
    """

    def __init__(self, until: float, exchange: Exchange[Any]) -> None:
        super().__init__(until)
        self.until, self.exchange = until, exchange


def resumed(command: Ask | Tell | Pause, exchange: Exchange[T]) -> Exchange[T]:
    """Return an exchange that has yielded its first command already as one that yields it anew."""
    try:
        while True:
            try:
                reply = yield command
            except ReplyError as error:
                command = exchange.throw(error)
            else:
                command = exchange.send(reply)
    except StopIteration as finished:
        result: T = finished.value
        return result
    finally:
        exchange.close()
