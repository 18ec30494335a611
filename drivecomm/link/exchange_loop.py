"""Execution of one exchange: sends telegrams, repeats requests, and waits out late replies."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeVar

from drivecomm.errors import (
    CommandCancelledError,
    DamagedReplyError,
    DoubtfulReplyError,
    OvertakenError,
    ReplyError,
)
from drivecomm.link.held_back import HeldBack
from drivecomm.link.other_masters import STRAGGLING_S, OpenRequest
from drivecomm.link.reply_matching import await_reply
from drivecomm.link.reply_trust import ReplyVote
from drivecomm.protocol import Ask, Pause, with_first_command

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.link.call_context import CallContext
    from drivecomm.link.line_state import LineState
    from drivecomm.link.peer import DriveRecord, Peer
    from drivecomm.link.port import Arrival, LinkSteps
    from drivecomm.protocol import Exchange, Message, Tell

T = TypeVar("T")

_OPEN = "; whether the drive acted on it is not known"


class PartialReply(NamedTuple):
    """Progress of a command that was begun on the short path.

    unasked: bytes received before its telegram could be sent. came: chunks received after sending; empty if the
    telegram was not sent.
    """

    unasked: bytes = b""
    came: Sequence[Arrival] = ()


def carry_out(call: CallContext, exchange: Exchange[T]) -> LinkSteps[T]:
    """Run an exchange and return its result. Raises what the exchange raises.

    An exchange that is cut off leaves the line unclean, and the next exchange drains it first.
    """
    line = call.line
    if not line.is_set_for(call.peer):
        yield from line.settle(call.peer)
    if line.unclean:
        line.heard_at = line.now
        yield from line.drain(call.peer, call.record)
    line.unclean = True
    return (yield from resume_exchange(call, exchange))


def resume_exchange(
    call: CallContext,
    exchange: Exchange[T],
    command: Ask | Tell | Pause | None = None,
    begun: PartialReply | None = None,
) -> LinkSteps[T]:
    """Run an exchange, or the rest of it from `command` on, which it has yielded already.

    begun: progress of `command`. Raises HeldBack if other calls may use the line before the command is sent.
    """
    line = call.line
    reply: Message | None = None
    error: ReplyError | None = None
    while True:
        if command is None:
            try:
                command = exchange.send(reply) if error is None else exchange.throw(error)
            except StopIteration as finished:
                line.unclean = False
                result: T = finished.value
                return result
            except Exception:
                # The exchange raised this itself; any draining was done where the request failed.
                line.unclean = False
                raise
        reply = error = None
        if call.may_be_held_back and isinstance(command, Ask) and (until := _held_back_until(call, command)) > line.now:
            line.unclean = False
            raise HeldBack(until, with_first_command(command, exchange))
        call.may_be_held_back = False
        try:
            if isinstance(command, Ask):
                reply = yield from _ask(call, command, begun)
            elif isinstance(command, Pause):
                yield from call.stay(line.now + command.seconds)
            else:
                yield from _tell(call, command, begun)
        except ReplyError as failed:
            error = failed
        except BaseException as failed:
            exchange.close()
            # A cancelled command was not sent, so no reply can be under way.
            line.unclean = not isinstance(failed, CommandCancelledError)
            raise
        command = begun = None


def _tell(call: CallContext, tell: Tell, begun: PartialReply | None) -> LinkSteps[None]:
    line, peer = call.line, call.peer
    if begun is None:
        call.check_command(acts=True)
    unasked, _ = begun or PartialReply()
    data = peer.telegram(tell.message)
    yield from line.send(peer, call.record, data, tell.message, unasked)
    note_sent(line, peer, tell, data)
    call.told = True


def note_sent(line: LineState, peer: Peer, tell: Tell, data: bytes) -> None:
    """Record that a telegram without a reply was sent."""
    line.told = data
    line.free_at = line.sent_at + (peer.facts.broadcast_pause_s if tell.pause_s is None else tell.pause_s)


def _ask(call: CallContext, ask: Ask, begun: PartialReply | None) -> LinkSteps[Message]:
    line, peer, record = call.line, call.peer, call.record
    timing = peer.facts.timing
    data = peer.telegram(ask.message)
    attempts = 1 if ask.prepared else ask.attempts or timing.attempts
    call.check_others()
    if must_wait_for_late_reply(record, ask, data):
        yield from _outwait_late_reply(call, ask, data)
    attempt = failed_in_a_row = 0
    answers = ReplyVote(call, ask, data)
    while True:
        attempt += 1
        if begun is None:
            next_at = record.asked_at + timing.request_interval_s
            if line.now < next_at:
                yield from call.stay(next_at)
            call.check_deadline()
            call.check_overtaken()
            call.check_command(acts=ask.acts)
            if ask.command:
                call.check_age(ask)
            record.asked_at = line.now
            record.count["requests" if attempt == 1 and not answers.doubts else "retries"] += 1
        unasked, came = begun or PartialReply()
        begun = None
        try:
            if not came:
                yield from line.send(peer, record, data, ask.message, unasked, mirrored=ask.mirrored)
            found = yield from await_reply(call, ask, data, came)
            if not answers.is_certain(found):
                attempt -= 1
                # The drive does answer, so its series of failures ends.
                failed_in_a_row = 0
                continue
        except ReplyError as error:
            doubtful, overtaken = isinstance(error, DoubtfulReplyError), isinstance(error, OvertakenError)
            damaged = isinstance(error, DamagedReplyError)
            record.count[
                "damaged" if damaged else "doubtful" if doubtful else "overtaken" if overtaken else "timeouts"
            ] += 1
            if not (doubtful or overtaken):
                line.request_failed(peer, record)
            if line.heard_at > record.asked_at:
                # If no bytes came, there is no transmission to wait out.
                if call.listen_until is not None:
                    line.probed = record
                yield from line.drain(peer, record)
            if doubtful:
                expect_reply(line, peer, record, ask, data)
                if answers.may_ask_again():
                    attempt -= 1
                    continue
            else:
                expect_late_reply(line, peer, record, ask, data)
            failed_in_a_row += 1
            others_wait = call.yields_to_others()
            ended = failed_in_a_row >= attempts or line.now >= call.deadline or overtaken
            if ended or doubtful or others_wait:
                call.failed = type(error)(f"{error}{_times(attempt)}{_OPEN if ask.acts else ''}")
                call.failed.others_wait = others_wait
                raise call.failed from None
        except BaseException:
            expect_late_reply(line, peer, record, ask, data)
            raise
        else:
            record.count["replies"] += 1
            record.health.answered()
            # Replies to earlier attempts may still come, and would pass for the reply to the same request sent
            # again later.
            record.surplus = attempt > 1 or (record.surplus and ask.distinct)
            if attempt > 1:
                for each in line.possible_repliers(peer, record, ask):
                    each.late_until, each.unanswered = line.sent_at + timing.late_s, data
                    each.nameless = ask.nameless
            if ask.command:
                record.commanded_at = line.sent_at
            return found.message


def _held_back_until(call: CallContext, ask: Ask) -> float:
    """Return the earliest time to send a request, at most the call's deadline; -inf if it may be sent now."""
    record = call.record
    if (
        ask.urgent
        or not record.unanswered
        or not must_wait_for_late_reply(record, ask, call.peer.telegram(ask.message))
    ):
        return float("-inf")
    return min(record.late_until, call.deadline)


def must_wait_for_late_reply(record: DriveRecord, ask: Ask, data: bytes) -> bool:
    """Return whether a late reply may still come that could be mistaken for the reply to this request."""
    if not record.unanswered or (ask.distinct and record.nameless):
        return False
    return record.unanswered != data or record.surplus


def expect_late_reply(line: LineState, peer: Peer, record: DriveRecord, ask: Ask, data: bytes) -> None:
    """Record that the reply to a request may still come.

    If that reply would not name its request, other requests must not be sent before it has come or is too late to come.
    """
    expect_reply(line, peer, record, ask, data)
    if ask.nameless:
        for each in line.possible_repliers(peer, record, ask):
            each.late_until, each.unanswered = line.now + peer.facts.timing.late_s, data
            each.surplus, each.nameless = False, True


def expect_reply(line: LineState, peer: Peer, record: DriveRecord, ask: Ask, data: bytes) -> None:
    """Add a request to those whose reply may still come, for each drive that this reply could come from."""
    until = line.now + peer.facts.timing.late_s + STRAGGLING_S
    for each in line.possible_repliers(peer, record, ask):
        each.owes(OpenRequest(data, ask.message, peer.mismatch, until))


def _outwait_late_reply(call: CallContext, ask: Ask, data: bytes) -> LinkSteps[None]:
    """Wait until late replies that name no request can no longer come, then drain the line.

    An urgent request is sent before this wait; its own attempts follow.
    """
    line, record = call.line, call.record
    if ask.urgent and line.now < record.late_until:
        yield from line.send(call.peer, record, data, ask.message)
    yield from call.stay(record.late_until)
    yield from line.drain(call.peer, record)
    for each in line.possible_repliers(call.peer, record, ask):
        if each.late_until <= line.now:
            each.unanswered, each.surplus = b"", False


def _times(attempts: int) -> str:
    return "" if attempts == 1 else f" (asked {attempts} times)"
