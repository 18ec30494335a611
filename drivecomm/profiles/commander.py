"""The master's side of a control profile: starting, stopping and acknowledging, in the order that the profile says.

What holds for every profile: a start is sent once, and taken back when the drive does not obey it in time, because a
standing order is an accident that waits; a stop is urgent, and confirmed by what the drive then says; a fault is
acknowledged by one edge, and only where there is one.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

from drivecomm.errors import (
    DeadlineError,
    NoReplyError,
    NotSupported,
    OvertakenError,
    RefusedError,
    ReplyError,
    StateError,
)
from drivecomm.protocol import Pause, unless_refused

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from drivecomm.profiles.profile import Condition, ControlProfile, Step, Words
    from drivecomm.protocol import DriveStatus, Exchange, Model, Reading, Stop

_POLL_S = 0.05
_RESTART_SILENCES = 3
"""How many questions without an answer are no end of a reset."""

_BUSY_S = 1.0
"""How long a stop is told again to a drive that is busy; other drives may wait for theirs."""


class Carrier(Protocol):
    """How control words and status words get to a drive and back: what a protocol package gives."""

    def look(self) -> Exchange[Words]:
        """Return the status words, by what commands nothing."""

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words | None]:
        """Send a control word; returns the status words that came with the reply, None where none did.

        urgent: for what stops the motor, see `Ask`.
        """


class Commander:
    """Commands one drive, or all at an address where nobody answers.

    state_timeout_s: how long a drive has for what it is told. advice: what to check when a drive does not start.
    answers: whether anybody answers at this address. fault_code: asks for the code of a fault, to name it; a drive that
    refuses it has its fault all the same. busy: the codes with which a drive refuses what it wants to be told again.
    again: returns the status words while something is awaited after a step, where it is sent again for that; else the
    carrier looks.
    """

    def __init__(
        self,
        profile: ControlProfile,
        carrier: Carrier,
        *,
        state_timeout_s: float,
        advice: str = "",
        answers: bool = True,
        fault_code: Callable[[], Exchange[int | None]] | None = None,
        busy: Collection[int] = (),
        again: Callable[[Step], Exchange[Words]] | None = None,
    ) -> None:
        self._profile = profile
        self._carrier = carrier
        self._state_timeout_s = state_timeout_s
        self._advice = f"; check {advice}" if advice else ""
        self._answers = answers
        self._fault_code = fault_code
        self._busy = busy
        self._again = again

    def status(self, model: Model | None, seen: Words | None = None, **further: Any) -> Exchange[DriveStatus]:
        """Return the status, with the code of a fault where it is asked for.

        model: says what the codes mean. seen: the status words, where they were read already. further: what else a
        `DriveStatus` tells, from elsewhere.
        """
        seen = seen or (yield from self._carrier.look())
        known, texts = self._profile.status(seen, **further), model.faults if model else {}
        if not known.fault or self._fault_code is None:
            return known
        code = yield from unless_refused(self._fault_code())
        return replace(known, fault_code=code, fault_text=texts.get(code, "") if code is not None else "")

    def start(self, *, reverse: bool = False, prepare: Exchange[None] | None = None) -> Exchange[None]:
        """Start the motor, each step of the way awaited. Raises StateError where it cannot be, or does not obey.

        prepare: what is done before the first word, once it is known that nothing speaks against a start.
        """
        profile = self._profile
        steps = profile.start_towards(reverse=reverse)
        seen = yield from self.check_start()
        if prepare is not None:
            yield from prepare
        # The way begins where the drive is; what its own steps lead to leaves none of them out.
        begun = seen
        for number, step in enumerate(steps):
            if any(condition.holds(begun) for condition in step.unless):
                continue
            try:
                seen = (yield from self._carry_out(step, urgent=False)) or seen
            except _NotReachedError as error:
                if number + 1 < len(steps):
                    raise StateError(
                        f"the drive did not come to {self._goal(step)!r} within {self._state_timeout_s:g} s; "
                        f"{error.shown}{self._advice}"
                    ) from None
                yield from self._take_back(error)
            except ReplyError as error:
                if number + 1 < len(steps):
                    raise
                raise type(error)(f"{error}; the drive had been told to run before") from None

    def check_start(self) -> Exchange[Words]:
        """Return the status words of a drive that can be started. Raises StateError where something forbids it."""
        seen = yield from self._carrier.look()
        for refusal in self._profile.refusals:
            if any(condition.holds(seen) for condition in refusal.when):
                code = ""
                if self._fault_code is not None and "{code}" in refusal.say and self._profile.status(seen).fault:
                    known = yield from unless_refused(self._fault_code())
                    code = "" if known is None else f" (code {known})"
                raise StateError(refusal.say.replace("{code}", code))
        return seen

    def stop(self, how: Stop) -> Exchange[None]:
        """Stop the motor by every step of the stop; what becomes of the last one decides.

        Raises StateError if the drive does not report that it obeys.
        """
        if how not in self._profile.stops:
            known = ", ".join(each.value for each in self._profile.stops)
            raise NotSupported(f"this drive has no {how.value} stop; use {known}")
        *before, last = self._profile.stops[how]
        for step in before:
            try:
                yield from self._carry_out(step, urgent=True)
            except (OvertakenError, DeadlineError):
                raise
            except (ReplyError, RefusedError, _NotReachedError):
                # The word that stops must go out, whatever became of those that prepare it.
                continue
        try:
            yield from self._carry_out(last, urgent=True)
        except _NotReachedError as error:
            raise StateError(f"the drive got the stop and does not report it: {error.shown}") from None

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault; does nothing on a drive without one. Raises StateError where the fault stays."""
        profile = self._profile
        if self._answers and not profile.status((yield from self._carrier.look())).fault:
            return
        for step in profile.reset:
            try:
                yield from self._carry_out(step, urgent=False)
            except _NotReachedError as error:
                raise StateError(
                    f"the drive is still tripped after the reset, the cause of its fault may last; {error.shown}"
                ) from None

    def _carry_out(self, step: Step, *, urgent: bool) -> Exchange[Words | None]:
        """Send a step, and wait until the drive is where it leads."""
        if step.pause_s:
            yield Pause(seconds=step.pause_s)
        seen = yield from (self._insisted(step) if urgent else self._carrier.send(step, urgent=False))
        if not step.until or not self._answers:
            return seen
        if seen is None:
            seen = yield from self._seen_after(step)
        waited = 0.0
        while not _any_holds(step.until, seen):
            if waited >= self._state_timeout_s:
                raise _NotReachedError(self._shown(step, seen))
            yield Pause(seconds=_POLL_S)
            waited += _POLL_S
            seen = yield from self._seen_after(step)
        return seen

    def _seen_after(self, step: Step) -> Exchange[Words]:
        """Look while something is awaited; a drive may restart on its reset, and be silent for a second or two."""
        patience = _RESTART_SILENCES if step in self._profile.reset else 0
        while True:
            try:
                return (yield from (self._again(step) if self._again else self._carrier.look()))
            except NoReplyError:
                if not patience:
                    raise
            patience -= 1

    def _insisted(self, step: Step) -> Exchange[Words | None]:
        """Send what stops the motor, again and again while the drive is busy."""
        waited = 0.0
        while True:
            try:
                return (yield from self._carrier.send(step, urgent=True))
            except RefusedError as error:
                if error.code not in self._busy or waited >= _BUSY_S:
                    raise
            yield Pause(seconds=_POLL_S)
            waited += _POLL_S

    def _take_back(self, error: _NotReachedError) -> Exchange[None]:
        for step in self._profile.take_back:
            with suppress(_NotReachedError):
                yield from self._carry_out(step, urgent=True)
        raise StateError(
            f"the drive did not run within {self._state_timeout_s:g} s after the start, which was taken back; "
            f"{error.shown}{self._advice}"
        ) from None

    def _goal(self, step: Step) -> str:
        return next((state.name for state in self._profile.states if state.known_by in step.until), "what was awaited")

    def _shown(self, step: Step, seen: Words) -> str:
        word = next(iter(seen.values()))
        says = ", ".join(self._profile.status(seen).flags) or "nothing"
        return f"after 0x{step.word:04X} its status word 0x{word:04X} says: {says}"


class _NotReachedError(Exception):
    """A drive is not where it was to be. shown: where it is."""

    def __init__(self, shown: str) -> None:
        self.shown = shown
        super().__init__(shown)


def _any_holds(conditions: Sequence[Condition], seen: Words) -> bool:
    return any(condition.holds(seen) for condition in conditions)


def taken_over(raw: int | None) -> int:
    """Return the reference that a drive shows in 16 bits. Raises StateError where it shows none."""
    if raw is None:
        raise StateError(
            "no reference was set from here, and the drive does not show the one that it has from the bus, so it "
            "would start with 0; set the reference first, while the motor stands: 0 where it comes from elsewhere"
        )
    return raw - 0x10000 if raw >= 0x8000 else raw


def check_needs(needs: Mapping[str, Sequence[object]], read: Callable[[str], Exchange[Reading]]) -> Exchange[None]:
    """Raise StateError unless parameters hold what a drive needs to obey; they are read, and never written.

    needs: the raw values that are right, by address.
    """
    for address, allowed in needs.items():
        found = yield from read(address)
        if found.raw not in allowed:
            raise StateError(
                f"{found.name or address} is {found}, and the drive obeys the bus only with "
                f"{' or '.join(map(str, allowed))}; set it first"
            )
