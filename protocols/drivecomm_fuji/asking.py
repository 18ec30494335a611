"""One request and what its reply says: the frame to use, the code of a refusal, patience with a busy inverter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import RefusedError, ReplyError
from drivecomm.protocol import Ask, Exchange, Pause, Tell, kept
from drivecomm_fuji.errorcodes import WRITE_BUSY, error_text
from drivecomm_fuji.telegrams import BROADCAST, Poll, Select, Standard
from drivecomm_fuji.timing import reply_timeout, slow_write
from drivecomm_fuji.words import ERROR

if TYPE_CHECKING:
    from drivecomm_fuji.options import FujiOptions


def read_request(address: int, function: str) -> Standard:
    """Return the standard request for a function's value."""
    return Standard(kind="request", address=address, command="R", function=function)


class Asking:
    """Requests to one station, or to all.

    A NAK with code 81 is asked again after a pause, no other NAK is (FRENIC-VG option manual 5-13). Optional frames
    carry no code, so M26 is read by a standard frame (FRENIC5000G11S technical information 2-57).

    An ACK of a write does not repeat the data in a way that could be relied on, so one that comes late could be taken
    for the answer to another write of the same function: writes and resets are nameless.
    """

    def __init__(self, address: int, options: FujiOptions) -> None:
        self._address = address
        self._options = options
        self._profile = options.generation
        self._read_ask = kept(self._new_read_ask)

    def ask_for(self, function: str) -> Exchange[Any]:
        """Ask for a value; the reply is a Standard, or a Poll where short frames are used. Raises RefusedError."""
        return self._ask(self._read_ask(function), function)

    def _new_read_ask(self, function: str) -> Ask:
        letter = _letter(self._profile.poll, function) if self._options.short_frames else ""
        request: Standard | Poll = read_request(self._address, function)
        if letter:
            request = Poll(kind="request", address=self._address, command=letter)
        return Ask(message=request, reply_timeout_s=reply_timeout(self._options, None))

    def write(self, function: str, data: int, *, attempts: int | None = None, urgent: bool = False) -> Exchange[None]:
        """Write a function's data word; urgent for what stops a motor. Raises RefusedError."""
        slow = slow_write(function, data)
        # Tuning turns the motor, and initialising must not begin anew.
        if slow is not None and slow.needs_s > 1:
            attempts = 1
        letter = _letter(self._profile.select, function) if self._options.short_frames else ""
        if letter:
            request: Standard | Select = Select(kind="request", address=self._address, command=letter, data=data)
        else:
            fast = self._options.high_speed_writes and "A" in self._profile.commands and self._address != BROADCAST
            # FRENIC-VG takes A for W, and its time for it (option manual 5-20).
            slow = None if fast and WRITE_BUSY in self._profile.error_codes else slow
            request = Standard(
                kind="request", address=self._address, command="A" if fast else "W", function=function, data=data
            )
        timeout = reply_timeout(self._options, slow)
        ask = Ask(message=request, attempts=attempts, acts=True, nameless=True, urgent=urgent, reply_timeout_s=timeout)
        yield from self._do(ask, function)

    def reset(self, command: str) -> Exchange[None]:
        """Send command E, or optional frame m, once. Raises RefusedError."""
        request: Standard | Select = Standard(kind="request", address=self._address, command="E")
        if command == "m":
            request = Select(kind="request", address=self._address, command="m", data=0)
        timeout = reply_timeout(self._options, None)
        ask = Ask(message=request, attempts=1, acts=True, nameless=True, reply_timeout_s=timeout)
        yield from self._do(ask, f"command {command}")

    def _do(self, ask: Ask, name: str) -> Exchange[None]:
        if self._address == BROADCAST:
            yield Tell(message=ask.message)
            return
        yield from self._ask(ask, name)

    def _ask(self, ask: Ask, name: str) -> Exchange[Any]:
        for repeat in range(self._options.busy_repeats + 1):
            if repeat:
                yield Pause(seconds=self._options.busy_pause_s)
            reply = yield ask
            if reply.kind == "ack":
                return reply
            code = reply.error_code if isinstance(reply, Standard) else (yield from self._latest_error())
            if code != WRITE_BUSY:
                break
        raise RefusedError(name, code, "no code is known" if code is None else error_text(code))

    def _latest_error(self) -> Exchange[int | None]:
        """Read M26; None when the inverter does not tell, or tells of no error."""
        try:
            reply = yield Ask(
                message=read_request(self._address, ERROR), reply_timeout_s=reply_timeout(self._options, None)
            )
        except ReplyError:
            return None
        return reply.data or None if reply.kind == "ack" else None


def _letter(letters: Any, function: str) -> str:
    return next((letter for letter, meant in letters.items() if meant == function), "")
