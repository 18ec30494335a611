"""Exchanges: the conversation behind one operation, as a generator that does no I/O.

An exchange yields commands. It is sent the reply to each `Ask`, and None for any other command. An error on the line is
thrown in at the yield as a ReplyError, and an exchange that handles it catches it there. An exchange never sees bytes,
a clock or a port; it returns the result of the operation.

    def read_state(address: int) -> Exchange[int]:
        reply = yield Ask(Enquiry(address=address, parameter=411))
        ...
        return state

A generator cannot communicate while it is being closed, so a `finally` block yields nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

from drivecomm.errors import RefusedError, ReplyError, UnexpectedReplyError

if TYPE_CHECKING:
    from drivecomm.errors import DriveCommError
    from drivecomm.protocol.telegram import Message

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ask:
    """Command to send a request and wait for its reply.

    - attempts: how often the request may be sent; None for the drive's own number. 1 for a request that must not be
      repeated: an edge, a start, a relative command.
    - prepared: without a reply, the request is not repeated, since the request before it, such as the choice of a page,
      would have to be repeated first.
    - acts: the drive acts on the request, so that without a reply it is unknown whether it did.
    - unseen: only the reply shows whether the drive acted, so a reply that may be a late one to another request is not
      trusted. DoubtfulReplyError is thrown in if the request must not be repeated.
    - nameless: the reply does not say which request it answers, so a late one could be mistaken for the reply to the
      next request.
    - distinct: a late nameless reply is never mistaken for the reply to this request, so there is no wait for late
      replies.
    - anonymous: the reply does not name a drive either, so a late reply of any drive of its protocol could be mistaken
      for it.
    - mirrored: the reply is the request itself, byte for byte, so an echo of the adapter could be mistaken for it. It
      is trusted only after an echo, or if nothing that was sent through this port has come back, which an unanswered
      `Tell` before the request shows.
    - urgent: the request stops a motor and does not wait for a late reply that may still come. It is sent immediately,
      and once more when its own reply can be trusted.
    - command: whether the request carries a command from which the drive's watchdog counts: "new" or "repeated". A
      repeated command that is older than the watchdog time is not sent; CommandTooOldError is thrown in instead.
    - reply_timeout_s: None for the drive's own.
    - besides: mismatches with which a sound telegram of the drive is returned although it is not the reply, because the
      exchange has to handle it.
    """

    message: Message
    attempts: int | None = None
    prepared: bool = False
    acts: bool = False
    unseen: bool = False
    nameless: bool = False
    distinct: bool = False
    anonymous: bool = False
    mirrored: bool = False
    urgent: bool = False
    command: Literal["", "new", "repeated"] = ""
    reply_timeout_s: float | None = None
    besides: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True, kw_only=True)
class Tell:
    """Command to send a telegram that no drive answers.

    pause_s: quiet time after the telegram; None for the drive's broadcast pause.
    """

    message: Message
    pause_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Pause:
    """Command to wait before the next command."""

    seconds: float


Command: TypeAlias = Ask | Tell | Pause
Exchange: TypeAlias = Generator[Command, Any, T]
"""Generator of one operation: it yields requests and pauses, is sent the replies, and returns the result."""


def unless_refused(exchange: Exchange[T], *others: type[DriveCommError]) -> Exchange[T | None]:
    """Return the result of an exchange; None if the drive refuses or one of the other errors is raised."""
    refused: tuple[type[DriveCommError], ...] = (RefusedError, *others)
    try:
        return (yield from exchange)
    except refused:
        return None


def answered(exchange: Exchange[T], answer: Callable[[Ask | Tell], Message | None]) -> T:
    """Run an exchange with a function in place of the line, and return its result; pauses take no time.

    answer: returns the reply to an `Ask`, and None for a `Tell`. A ReplyError that it raises is thrown into the
    exchange; any other exception ends the exchange.
    """
    try:
        command = next(exchange)
        while True:
            try:
                reply = None if isinstance(command, Pause) else answer(command)
            except ReplyError as error:
                command = exchange.throw(error)
            else:
                command = exchange.send(reply)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        exchange.close()


def asked_once(exchange: Exchange[T]) -> Exchange[T]:
    """Run an exchange without repeating any of its requests, as is needed before a stop.

    Raises UnexpectedReplyError if the exchange pauses, for example because the drive is busy.
    """
    return with_each_command(exchange, _once)


def _once(command: Command) -> Command:
    if isinstance(command, Pause):
        raise UnexpectedReplyError("the drive is not ready to answer, and a stop does not wait for that")
    return replace(command, attempts=1) if isinstance(command, Ask) else command


def with_each_command(
    exchange: Exchange[T], change: Callable[[Command], Command], heard: Callable[[Message], None] | None = None
) -> Exchange[T]:
    """Run an exchange with each of its commands changed by a function; an exception of that function ends the exchange.

    heard: called with each reply.
    """
    try:
        command = next(exchange)
    except StopIteration as end:
        result: T = end.value
        return result
    return (yield from _from(command, exchange, change, heard))


def resumed(command: Command, exchange: Exchange[T]) -> Exchange[T]:
    """Return an exchange that has already yielded its first command as one that yields this command again."""
    return _from(command, exchange, _unchanged, None)


def _unchanged(command: Command) -> Command:
    return command


def _from(
    command: Command,
    exchange: Exchange[T],
    change: Callable[[Command], Command],
    heard: Callable[[Message], None] | None,
) -> Exchange[T]:
    """Run the rest of an exchange, beginning with a command that it has already yielded."""
    try:
        while True:
            changed = change(command)
            try:
                reply = yield changed
            except ReplyError as error:
                command = exchange.throw(error)
            else:
                if heard is not None and reply is not None:
                    heard(reply)
                command = exchange.send(reply)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        exchange.close()
