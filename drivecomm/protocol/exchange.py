"""Exchanges: the conversation behind one operation, as a generator that does no I/O.

An exchange yields commands and is sent the reply to each `Ask`, or None for the others. What goes wrong on the line is
thrown in at the yield as a ReplyError, so an exchange that wants to react catches it there. It never sees bytes, a
clock or a port; it returns the result of the operation.

    def read_state(address: int) -> Exchange[int]:
        reply = yield Ask(Enquiry(address=address, parameter=411))
        ...
        return state

A generator cannot talk while it is being closed, so nothing is yielded in a `finally`.
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
    """Send a request and wait for its reply.

    attempts: how often it may be sent; None for the drive's own number. 1 for what must not happen twice: an edge, a
    start, a relative command. prepared: where no reply comes it is not sent again, since the question before it, such
    as the choice of a page, would have to be repeated first. acts: the drive does something on it, so that a missing
    reply leaves open whether it did. unseen: nothing but its reply shows that, so one that may be a late one to another
    request is not believed: DoubtfulReplyError is thrown in where it must not be sent again.
    nameless: the reply does not say what it answers, so a late one could be taken for the next request's. urgent: not
    to be held back by a late reply that may still come, because it stops a motor; it then goes out at once, and once
    more when its own reply can be believed.
    distinct: no reply that names nothing is taken for this one's, however late it comes: nothing is waited for.
    anonymous: the reply names no drive either, so a late one of any drive of its protocol could be taken for it.
    command: whether the request carries a command from which the drive's watchdog counts: a "new" one, or one that is
    "repeated", which is not sent when it is older than that watchdog waits; CommandTooOldError is thrown in instead.
    reply_timeout_s: None for the drive's own. mirrored: the reply is the request itself, byte for byte, which an echo
    is, too; so it is believed only behind an echo, or where nothing that was sent through this port has come back: a
    `Tell` before it that nobody answers shows that. besides: for what mismatches a sound telegram of the drive that is
    not the reply is returned all the same, because the exchange has to do something about it.
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
    """Send a telegram that nobody answers. pause_s: quiet time after it; None for the drive's broadcast pause."""

    message: Message
    pause_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Pause:
    """Let time pass."""

    seconds: float


Command: TypeAlias = Ask | Tell | Pause
Exchange: TypeAlias = Generator[Command, Any, T]
"""An operation: it yields requests and pauses, is sent the replies, and returns its result."""


def unless_refused(exchange: Exchange[T], *others: type[DriveCommError]) -> Exchange[T | None]:
    """Return what an exchange returns, None where the drive refuses, or where one of these other errors is raised."""
    refused: tuple[type[DriveCommError], ...] = (RefusedError, *others)
    try:
        return (yield from exchange)
    except refused:
        return None


def answered(exchange: Exchange[T], answer: Callable[[Ask | Tell], Message | None]) -> T:
    """Carry out an exchange with a function in place of the line, and return its result; pauses take no time.

    answer: returns the reply to an `Ask`, and None for a `Tell`. A ReplyError that it raises is thrown into the
    exchange; anything else that it raises ends it.
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
    """Carry out an exchange without repeating any of its requests: for what is asked before a stop.

    Raises UnexpectedReplyError where the exchange would pause, as for a drive that is busy.
    """
    return with_each_command(exchange, _once)


def _once(command: Command) -> Command:
    if isinstance(command, Pause):
        raise UnexpectedReplyError("the drive is not ready to answer, and a stop does not wait for that")
    return replace(command, attempts=1) if isinstance(command, Ask) else command


def with_each_command(
    exchange: Exchange[T], change: Callable[[Command], Command], heard: Callable[[Message], None] | None = None
) -> Exchange[T]:
    """Carry out an exchange with what a function makes of each of its commands; what it raises ends the exchange.

    heard: told each reply.
    """
    try:
        command = next(exchange)
    except StopIteration as end:
        result: T = end.value
        return result
    return (yield from _from(command, exchange, change, heard))


def resumed(command: Command, exchange: Exchange[T]) -> Exchange[T]:
    """Return an exchange that has yielded its first command already as one that yields it anew."""
    return _from(command, exchange, _unchanged, None)


def _unchanged(command: Command) -> Command:
    return command


def _from(
    command: Command,
    exchange: Exchange[T],
    change: Callable[[Command], Command],
    heard: Callable[[Message], None] | None,
) -> Exchange[T]:
    """Carry out what is left of an exchange from a command on that it has yielded."""
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
