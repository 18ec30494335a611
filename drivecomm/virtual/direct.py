"""Exchanges with a virtual drive itself, on no line and in no time: what a master would be told now."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from drivecomm.errors import NoReplyError
from drivecomm.protocol import Ask, Framed, Tell, answered

if TYPE_CHECKING:
    from drivecomm.protocol import Codec, Exchange, Message, VirtualDrive

T = TypeVar("T")


def carry_out(exchange: Exchange[T], drive: VirtualDrive, codec: Codec, now: float) -> T:
    """Carry out an exchange of the drive's protocol. Raises what the exchange raises; NoReplyError for silence.

    codec: the master's, for the drive's options.
    """

    def answer(command: Ask | Tell) -> Message | None:
        reply = answer_to(command.message, drive, codec, now)
        if isinstance(command, Ask) and reply is None:
            raise NoReplyError(f"the virtual drive at address {drive.address} does not answer")
        return reply

    return answered(exchange, answer)


def answer_to(request: Message, drive: VirtualDrive, codec: Codec, now: float) -> Message | None:
    """Return what a drive answers to a request, None for silence."""
    data = codec.encode(request)
    reply = drive.hear(Framed(data, drive.codec.decode(data, "request")), now)
    return None if reply is None else codec.decode(reply.data, "reply")
