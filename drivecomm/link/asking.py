"""Carrying out one exchange: telegrams are told, questions are asked and repeated, late replies waited out."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from drivecomm.errors import (
    CommandCancelledError,
    DamagedReplyError,
    OvertakenError,
    ReplyError,
)
from drivecomm.link.reception import await_reply
from drivecomm.protocol import Ask, Pause

if TYPE_CHECKING:
    from drivecomm.link.call import Call
    from drivecomm.link.port import Steps
    from drivecomm.protocol import Exchange, Message, Tell

T = TypeVar("T")

_OPEN = "; whether the drive acted on it is not known"


def carry_out(call: Call, exchange: Exchange[T]) -> Steps[T]:
    """Carry out an exchange and return its result; raises what it raises.

    One that is cut off leaves the line unclean, and whoever is next begins with draining it.
    """
    line = call.line
    if line.settings != call.peer.facts.settings:
        yield from line.settle(call.peer)
    if line.unclean:
        line.heard_at = line.now
        yield from line.drain(call.peer, call.partner)
    line.unclean = True
    reply: Message | None = None
    error: ReplyError | None = None
    while True:
        try:
            command = exchange.send(reply) if error is None else exchange.throw(error)
        except StopIteration as finished:
            line.unclean = False
            result: T = finished.value
            return result
        except Exception:
            # The exchange ended by its own decision; what had to be drained was drained where it went wrong.
            line.unclean = False
            raise
        reply = error = None
        try:
            if isinstance(command, Ask):
                reply = yield from _ask(call, command)
            elif isinstance(command, Pause):
                yield from call.stay(line.now + command.seconds)
            else:
                yield from _tell(call, command)
        except ReplyError as failed:
            error = failed
        except BaseException as failed:
            exchange.close()
            # What was cancelled was not sent, so nothing is under way.
            line.unclean = not isinstance(failed, CommandCancelledError)
            raise


def _tell(call: Call, tell: Tell) -> Steps[None]:
    call.check_cancelled()
    line, peer = call.line, call.peer
    yield from line.send(peer, call.partner, peer.codec.encode(tell.message), tell.message)
    pause = peer.facts.broadcast_pause_s if tell.pause_s is None else tell.pause_s
    line.free_at = line.sent_at + pause


def _ask(call: Call, ask: Ask) -> Steps[Message]:
    line, peer, partner = call.line, call.peer, call.partner
    timing = peer.facts.timing
    data = peer.codec.encode(ask.message)
    attempts = ask.attempts or timing.attempts
    if partner.unanswered and (partner.unanswered != data or partner.surplus):
        yield from _outwait_late_reply(call, ask, data)
    attempt = 0
    while True:
        attempt += 1
        next_at = partner.asked_at + timing.request_interval_s
        if line.now < next_at:
            yield from call.stay(next_at)
        call.check_deadline()
        call.check_overtaken()
        call.check_cancelled()
        if ask.command:
            call.check_age(ask)
        partner.asked_at = line.now
        partner.count["requests" if attempt == 1 else "retries"] += 1
        try:
            yield from line.send(peer, partner, data, ask.message)
            message = yield from await_reply(call, ask, data)
        except ReplyError as error:
            partner.count["damaged" if isinstance(error, DamagedReplyError) else "timeouts"] += 1
            if not isinstance(error, OvertakenError):
                line.request_failed(peer, partner)
            if line.heard_at > partner.asked_at:
                # Where nothing came at all there is nothing to let finish.
                if call.listen_until is not None:
                    line.probed = partner
                yield from line.drain(peer, partner)
            _expect_late_reply(call, ask, data)
            if attempt == attempts or line.now >= call.deadline or isinstance(error, OvertakenError):
                raise type(error)(f"{error}{_times(attempt)}{_OPEN if ask.acts else ''}") from None
        except BaseException:
            _expect_late_reply(call, ask, data)
            raise
        else:
            partner.count["replies"] += 1
            partner.health.answered()
            # The replies to the attempts before may still come, and would answer the same question as if it were asked
            # anew.
            partner.surplus = attempt > 1
            if partner.surplus:
                partner.late_until, partner.unanswered = line.sent_at + timing.late_s, data
            if ask.command:
                partner.commanded_at = line.sent_at
            return message


def _expect_late_reply(call: Call, ask: Ask, data: bytes) -> None:
    """Keep in mind that a reply which does not name its request may still come."""
    if ask.nameless:
        partner = call.partner
        partner.late_until, partner.unanswered = call.line.now + call.peer.facts.timing.late_s, data
        partner.surplus = False


def _outwait_late_reply(call: Call, ask: Ask, data: bytes) -> Steps[None]:
    """Do not ask for something else while a reply that does not name its request may still come."""
    line, partner = call.line, call.partner
    if ask.urgent and line.now < partner.late_until:
        yield from line.send(call.peer, partner, data, ask.message)
    yield from call.stay(partner.late_until)
    yield from line.drain(call.peer, partner)
    partner.unanswered, partner.surplus = b"", False


def _times(attempts: int) -> str:
    return "" if attempts == 1 else f" (asked {attempts} times)"
