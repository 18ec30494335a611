"""Reception of the reply to one request: received bytes are framed, compared with the request, and believed or not."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import DamagedReplyError, DeadlineError, NoReplyError, OvertakenError
from drivecomm.link.echo import in_place_of_echo
from drivecomm.link.port import LinkSteps, Receive
from drivecomm.link.reply_trust import BY_CHANCE, STRAY_CHARACTERS, FittingReply, judge_reply, note_reply
from drivecomm.protocol import LINE_ERROR, Damaged, Framed, Framer, Noise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.link.call_context import CallContext
    from drivecomm.link.port import Arrival
    from drivecomm.protocol import Ask

# The longest known telegram (Danfoss FC with LGE 255); limits the wait on a line that is never silent.
LONGEST_TELEGRAM = 257
_ECHO = "the adapter echoes what it sends, and no other reply came; open the port with echo on"
_IN_PLACE_OF_ECHO = "what came may be a disturbed echo; if this adapter has none, open the port with echo off"


def await_reply(call: CallContext, ask: Ask, data: bytes, heard: Sequence[Arrival] = ()) -> LinkSteps[Framed]:
    """Return the reply to a request that was just sent as `data`. Raises ReplyError.

    Raises DoubtfulReplyError if the reply may also answer a request of another master, or if two replies differ. heard:
    chunks that were received since sending, if the caller has waited for them already.
    """
    known = iter(heard)
    line, peer, record = call.line, call.peer, call.record
    settings, timing, gap_s, echo = peer.settings, peer.facts.timing, peer.gap_s, line.echo
    timeout = timing.reply_timeout_s if ask.reply_timeout_s is None else ask.reply_timeout_s
    sent_at = line.sent_at
    # The listening time of a probe is learnt on this line, so it already includes the delay of a network.
    arrives_s = peer.arrives_within_s(data, paced=call.paced or call.listen_until is not None)
    if call.listen_until is not None:
        timeout = min(timeout, max(line.delays.minimum_listen_s(peer.protocol), call.listen_until - sent_at))
    limit = deadline = sent_at + (arrives_s + timeout)
    if limit > call.deadline:
        limit = deadline = max(call.deadline, sent_at)
        timeout = 0.0
    latest = limit + settings.wire_s(LONGEST_TELEGRAM) + gap_s
    # The first character of a reply cannot be complete before this time.
    earliest = sent_at + peer.character_s / 2 if call.paced else 0.0
    framer = Framer(peer.codec, "reply")
    damage, not_understood, stray, early, first = "", False, "", b"", b""
    taken, noise, handed_back = 0, 0, False
    in_haste, gives_way = False, call.gives_way
    fits: FittingReply | None = None
    while True:
        arrival = next(known, None)
        if arrival is None:
            arrival = yield Receive(deadline, framer.missing + echo.missing, gives_way)
        line.now, came, _ = arrival
        if gives_way and call.stop_waits():
            # A reply that has begun is received to its end; one that has not gets the usual delay of its protocol.
            in_haste, gives_way = True, False
            limit = min(limit, max(line.now, sent_at + line.delays.minimum_listen_s(peer.protocol)))
            if fits is not None:
                fits.until = deadline = line.now
            elif not framer.begun:
                deadline = min(deadline, limit)
        if not came and line.now < deadline:
            continue
        if came:
            line.heard_at = line.now
            if line.now < earliest:
                # While the request is being sent, bytes can only be its echo or a late reply.
                early += came
                handed_back = data in early
                stray = _ECHO if line.drop_early_bytes(peer, record, came, is_echo=data.startswith(early)) else ""
                line.echoes = line.echoes or (handed_back and not echo.looking)
                continue
        quiet = not came
        if echo.looking:
            came = line.without_echo(peer, record, came)
            quiet = quiet and not came
        elif len(first) < len(data):
            first += came
            # Bytes from before the end of sending that repeat the request can only be its echo.
            handed_back = handed_back or (bool(early) and (early + first).startswith(data))
        place = taken - framer.held
        taken += len(came)
        for find in framer.flush() if quiet else framer.feed(came):
            if isinstance(find, Framed):
                in_place = in_place_of_echo(find.data, place, echo.excused)
                # If the reply equals the request, its first copy is the reply only on a line without echo.
                echoes = line.echoes or not echo.is_over or (line.told and line.told in first)
                sent_back = ask.mirrored and (handed_back or not echoes)
                is_echo = in_place or (find.data == data and not sent_back)
                handed_back = handed_back or is_echo
                reason = "echo" if is_echo else peer.mismatch(ask.message, find.message)
                if noise > STRAY_CHARACTERS and len(find.data) == 1 and not reason:
                    line.note(peer, "noise", find.data)
                    place += 1
                    damage = BY_CHANCE
                    continue
                if fits is not None and (not reason or reason in ask.besides):
                    fits.compare(call, data, find)
                    place += len(find.data)
                    continue
                if not reason or reason in ask.besides:
                    if line.echo.looking and line.echo.answered(place):
                        record.count["echoes missing"] += 1
                    came_back = handed_back or (first.startswith(data) and find.data != data)
                    # From now on a reply that equals its request is believed only after an echo.
                    line.echoes = line.echoes or (came_back and not echo.looking)
                    fits = judge_reply(call, ask, data, find, in_haste=in_haste)
                    place += len(find.data)
                    continue
                place += len(find.data)
                if reason == LINE_ERROR:
                    # The drive has received a damaged request, and sends no other reply.
                    line.note(peer, "received", find.data, find.message, detail=reason)
                    damage, not_understood = reason, True
                    continue
                _count_stray(call, find, reason)
                if reason != "echo":
                    line.others.pass_by(find.data)
                # The user's setting that there is no echo may be wrong.
                line.echoes = line.echoes or (reason == "echo" and not echo.looking)
                if reason != "echo":
                    stray = f"the reply that came differs in {reason}"
                else:
                    stray = _IN_PLACE_OF_ECHO if in_place else _ECHO
            else:
                wrong = _count_garbage(call, find)
                if taken > echo.excused:
                    damage = wrong or damage
                    if isinstance(find, Noise):
                        noise += len(find.data)
                        line.others.pass_by(find.data)
                    if fits is not None and len(fits.find.data) == 1:
                        fits.doubt = f"the reply of {peer.name} is {BY_CHANCE}"
                place += len(find.data) if isinstance(find, Noise) else 0
        # Once a reply has begun only the gap limit counts; before that, the reply time keeps running.
        begun = framer.begun or damage
        deadline = line.now + settings.wire_s(framer.missing) + gap_s if begun else limit
        if fits is not None and not (framer.begun and line.now < fits.until):
            deadline = fits.until
        if (quiet and damage) or line.now >= min(deadline, latest):
            break
    if fits is not None:
        for find in framer.flush():
            if isinstance(find, Noise):
                line.others.pass_by(find.data)
        return fits.taken(call, data)
    line.judge(peer, data)
    if echo.doubted and not (damage or stray or handed_back):
        # Nothing followed these bytes, so they count as the reply, as on a line without echo.
        note_reply(line, peer, record, len(data), line.now)
        message = peer.codec.decode(data, "reply")
        line.note(peer, "received", data, message)
        return Framed(data, message)
    if first.startswith(data):
        damage, stray = "", _ECHO
    if not_understood and not in_haste:
        raise DamagedReplyError(f"{peer.name} reports that the request arrived damaged")
    if damage and not in_haste:
        raise DamagedReplyError(f"{peer.name} answered with a damaged telegram ({damage})")
    why = f": {stray}" if stray else ""
    if in_haste:
        raise OvertakenError(f"{peer.name} was no longer awaited, because a stop went first{why}")
    if not timeout:
        raise DeadlineError(f"{peer.name} did not answer before the call's deadline ({timing.deadline_s:g} s){why}")
    raise NoReplyError(f"{peer.name} did not answer within {timeout * 1000:.0f} ms{why}")


def _count_stray(call: CallContext, find: Framed, reason: str) -> None:
    call.record.count["echoes" if reason == "echo" else "strays"] += 1
    call.line.note(call.peer, "echo" if reason == "echo" else "stray", find.data, find.message, detail=reason)
    call.line.heard_out_of_turn()


def _count_garbage(call: CallContext, find: Damaged | Noise) -> str:
    """Count a damaged telegram or noise; return the damage, or an empty string for noise."""
    if isinstance(find, Noise):
        call.record.count["noise bytes"] += len(find.data)
        call.line.note(call.peer, "noise", find.data)
        return ""
    call.record.count[f"{find.error.category} errors"] += 1
    call.line.note(call.peer, "damaged", find.data, detail=str(find.error))
    return str(find.error)
