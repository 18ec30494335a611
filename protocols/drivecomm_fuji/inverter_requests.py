"""Requests to an inverter and their replies: the frame to use, the code of a refusal, and retries while it is busy.

Also the run command: S06, which carries terminals and run command together, and M14, which shows its effect. FVR-E11S
manual 9-20; AF-300 Ethernet manual p. 35, 36; HVAC/AQUA RS-485 manual, preface.

S01 overrides S05 as soon as it is not zero (FVR-E11S manual 9-20). A read of either returns the value that was sent and
not the one in effect, and any master may have set the other one. So the other one is set to zero each time, and the
effective reference is read back: M05 in hertz, M01 as a share of the maximum frequency. A value of 0 while the motor
stands proves nothing.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import RefusedError, ReplyError, StateError
from drivecomm.protocol import Ask, Exchange, Pause, Tell, cached, unless_refused
from drivecomm_fuji import words
from drivecomm_fuji.generations import WRITE_BUSY, error_text, slow_write
from drivecomm_fuji.telegrams import BROADCAST, PollFrame, SelectFrame, StandardFrame
from drivecomm_fuji.words import COMMAND, ERROR, FREQUENCY, FREQUENCY_PU, RUN

if TYPE_CHECKING:
    from collections.abc import Mapping
    from decimal import Decimal

    from drivecomm.profiles import ControlStep, Words
    from drivecomm_fuji.options import FujiOptions

_NEAR_PU = 10
"""Largest difference between S01 and the displayed reference, in steps of 0.005 %: 0.01 Hz of 20 Hz."""


@dataclass(slots=True, kw_only=True)
class FujiMemory:
    """State that a master keeps about one inverter, shared by all its users on a bus.

    word: the last S06 that was commanded here, kept because it carries terminals and run command together; FWD and REV
    only while they are confirmed. s01_beats: whether the S01 last written by a plain write from here is not zero, which
    only leads to a note.
    """

    word: int = 0
    s01_beats: bool = False

    def forget(self) -> None:
        """Clear FWD and REV; terminals stay as they were set here."""
        self.word &= ~RUN
        self.s01_beats = False

    def watch(self, silence_s: float | None) -> None:
        """Do nothing, since every request to an inverter feeds its watchdog."""


class FujiRequests:
    """Requests to one station, or to all.

    A request is repeated after a pause if its NAK has code 81, and after no other NAK (FRENIC-VG option manual 5-13).
    Optional frames carry no code, so M26 is read by a standard frame (FRENIC5000G11S technical information 2-57).

    The ACK of a write does not repeat the data reliably, so a late one could be mistaken for the reply to another write
    of the same function. Therefore writes and resets are nameless.
    """

    def __init__(self, address: int, options: FujiOptions, memory: FujiMemory) -> None:
        self._address = address
        self._options = options
        self._memory = memory
        self._profile = options.generation
        self._quick_s = options.reply_timeout()
        self.read_ask = cached(self._new_read_ask)
        """Returns the request that reads a function; requests are cached."""

    def ask_for(self, function: str) -> Exchange[Any]:
        """Read a value; the reply is a StandardFrame, or a PollFrame if short frames are used. Raises RefusedError."""
        return self._ask(self.read_ask(function), function)

    def _new_read_ask(self, function: str) -> Ask:
        letter = self._letter(self._profile.poll, function)
        if not letter:
            return self._standard_read(function)
        request = PollFrame(kind="request", address=self._address, command=letter)
        return Ask(message=request, reply_timeout_s=self._quick_s)

    def _standard_read(self, function: str, attempts: int | None = None) -> Ask:
        request = StandardFrame(kind="request", address=self._address, command="R", function=function)
        return Ask(message=request, attempts=attempts, reply_timeout_s=self._quick_s)

    def _letter(self, letters: Mapping[str, str], function: str) -> str:
        """Return the letter of the short frame for a function; empty if there is none or short frames are not used."""
        found = (letter for letter, meant in letters.items() if meant == function and self._options.short_frames)
        return next(found, "")

    def write(self, function: str, data: int, *, attempts: int | None = None, urgent: bool = False) -> Exchange[None]:
        """Write a function's data word. Raises RefusedError.

        urgent: for a write that stops a motor.
        """
        slow = slow_write(function, data)
        # Never repeat these: tuning turns the motor, and initialising must not begin again.
        if slow is not None and slow.needs_s > 1:
            attempts = 1
        letter = self._letter(self._profile.select, function)
        if letter:
            request: StandardFrame | SelectFrame = SelectFrame(
                kind="request", address=self._address, command=letter, data=data
            )
        else:
            fast = self._options.high_speed_writes and "A" in self._profile.commands and self._address != BROADCAST
            # FRENIC-VG treats A like W, and needs the same time for it (option manual 5-20).
            slow = None if fast and WRITE_BUSY in self._profile.error_codes else slow
            request = StandardFrame(
                kind="request", address=self._address, command="A" if fast else "W", function=function, data=data
            )
        timeout = self._options.reply_timeout(slow)
        ask = Ask(message=request, attempts=attempts, acts=True, nameless=True, urgent=urgent, reply_timeout_s=timeout)
        yield from self._do(ask, function)

    def reset(self, command: str) -> Exchange[None]:
        """Send command E, or optional frame m, once. Raises RefusedError."""
        request: StandardFrame | SelectFrame = StandardFrame(kind="request", address=self._address, command="E")
        if command == "m":
            request = SelectFrame(kind="request", address=self._address, command="m", data=0)
        ask = Ask(message=request, attempts=1, acts=True, nameless=True, reply_timeout_s=self._quick_s)
        yield from self._do(ask, f"command {command}")

    def look(self) -> Exchange[Words]:
        """Read M14; if the motor does not run, clear the run command, so that it is not sent again."""
        reply = yield from self.ask_for(words.STATUS)
        seen = {profiles.SOLE_PLACE: reply.data}
        if not words.control_profile().says("running", seen):
            # Whatever has stopped the motor, no later write may start it again.
            self._memory.forget()
        return seen

    def send(self, step: ControlStep, *, urgent: bool) -> Exchange[None]:  # noqa: ARG002 - the word decides
        """Change the bits of S06 that belong to the step, or send the command in its place.

        RST is cleared again if it is unknown whether the word arrived.
        """
        if step.place:
            yield from self.reset(step.place)
            return
        word = self._memory.word & ~step.mask | step.word
        try:
            yield from self.command(word)
        except ReplyError:
            if word & words.RESET:
                with suppress(ReplyError):
                    yield from self.command(word & ~words.RESET)
            raise

    def alarm_code(self) -> Exchange[int | None]:
        """Read the latest alarm; None if the inverter does not report it."""
        reply = yield from unless_refused(self.ask_for(words.ALARM))
        return None if reply is None else reply.data

    def command(self, word: int) -> Exchange[None]:
        """Write S06. A run command is sent once, and remembered only after it was confirmed."""
        acts = bool(word & (RUN | words.RESET))
        self._memory.word = word & ~(RUN | words.RESET)
        yield from self.write(COMMAND, word, attempts=1 if acts else None, urgent=not word & RUN)
        self._memory.word = word & ~words.RESET

    def switch(self, on: int, off: int) -> Exchange[None]:
        """Set and clear terminals. Raises StateError if sending the remembered run bits would command the motor.

        The status alone is not enough: a motor that another program has stopped still runs while it ramps down.
        """
        if self._address != BROADCAST and (yield from self._runs()):
            reply = yield from self.ask_for(COMMAND)
            if reply.data & RUN != self._memory.word & RUN:
                self._memory.forget()
                raise StateError(
                    "the motor runs, and S06 holds a run command that is not the one of this program; it carries "
                    "terminals and run command together, so the motor would obey the other one: start or stop it from "
                    "here first"
                )
        yield from self.command(self._memory.word & ~off | on)

    def set_frequency(self, data: int) -> Exchange[None]:
        """Write S05, in hundredths of a hertz. Raises StateError if another reference is then in effect."""
        yield from self.write(FREQUENCY_PU, 0)
        yield from self.write(FREQUENCY, data)
        yield from self._confirm(words.FINAL, data, 1, words.HUNDREDTH_HZ, "Hz")

    def set_per_unit(self, data: int) -> Exchange[None]:
        """Write S01, signed, in 20000ths of the maximum. Raises StateError if another reference is then in effect."""
        if self._profile.s05_is_frequency:
            yield from self.write(FREQUENCY, 0)
        yield from self.write(FREQUENCY_PU, data % 0x10000)
        # Allow a difference: some inverters keep hundredths of a hertz, and show steps of the maximum frequency.
        yield from self._confirm(words.FINAL_PU, abs(data), _NEAR_PU, words.STEP_PU, "%")

    def _confirm(self, function: str, meant: int, near: int, scale: Decimal, unit: str) -> Exchange[None]:
        """Read back the final reference. Raises StateError if it differs; 0 at standstill means "not shown"."""
        if not self._options.reference_read_back or self._address == BROADCAST:
            return
        remedy = "if it shows no reference in standstill, use the option reference_read_back=False"
        try:
            reply: Any = yield from self.ask_for(function)
        except RefusedError as error:
            raise StateError(f"the inverter took the reference and does not show it: {error}; {remedy}") from None
        shown = 0x10000 - reply.data if reply.data >= 0x8000 and function == words.FINAL_PU else reply.data
        if abs(shown - meant) <= near:
            return
        # No known manual says what M05 and M01 show while the motor stands.
        if shown or (yield from self._runs()):
            raise StateError(
                f"the inverter took a reference of {meant * scale} {unit}, and its final reference ({function}) is "
                f"{shown * scale} {unit}: it is limited (F03, F15), or comes from elsewhere (H30, F01); {remedy}"
            )

    def _runs(self) -> Exchange[bool]:
        return bool(words.control_profile().says("running", (yield from self.look())))

    def probe(self) -> Exchange[None]:
        """Request the status once; a NAK also proves that there is an inverter."""
        yield self._standard_read(words.STATUS, attempts=1)

    def _do(self, ask: Ask, name: str) -> Exchange[None]:
        if self._address == BROADCAST:
            yield Tell(message=ask.message)
            return
        yield from self._ask(ask, name)

    def _ask(self, ask: Ask, name: str) -> Exchange[Any]:
        reply = yield ask
        return reply if reply.kind == "ack" else (yield from self.again(ask, reply, name))

    def again(self, ask: Ask, reply: Any, name: str) -> Exchange[Any]:
        """Return the reply to a request that got a NAK, repeating it while the inverter is busy.

        Raises RefusedError.
        """
        left = self._options.busy_repeats
        while reply.kind != "ack":
            code = reply.error_code if isinstance(reply, StandardFrame) else (yield from self._latest_error())
            if code != WRITE_BUSY or not left:
                raise RefusedError(name, code, "no code is known" if code is None else error_text(code))
            left -= 1
            yield Pause(seconds=self._options.busy_pause_s)
            reply = yield ask
        return reply

    def _latest_error(self) -> Exchange[int | None]:
        """Read M26; None if the inverter does not report it, or reports no error."""
        try:
            reply = yield self._standard_read(ERROR)
        except ReplyError:
            return None
        return reply.data or None if reply.kind == "ack" else None
