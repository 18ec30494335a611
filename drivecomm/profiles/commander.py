"""The master's side of a control profile: starting, stopping and acknowledging, in the order of the profile.

These rules hold for every profile. A start is sent once, and taken back if the drive does not obey it in time, since a
start that stays in force could move the motor at any later moment. A stop is urgent, and the next status of the drive
must confirm it. A fault is acknowledged by one edge, and only if there is one.
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

    from drivecomm.profiles.profile import BitCondition, ControlProfile, ControlStep, Words
    from drivecomm.protocol import DriveStatus, Exchange, Model, Reading, Stop

_POLL_S = 0.05
_RESTART_SILENCES = 3
"""Number of unanswered requests that do not end a reset."""

_BUSY_S = 1.0
"""Seconds for which a stop is repeated to a busy drive; not longer, since other drives may wait for their stops."""


class WordTransport(Protocol):
    """Transport of control words to a drive and of status words back, which a protocol package provides."""

    def look(self) -> Exchange[Words]:
        """Return the status words, read by requests that command nothing."""

    def send(self, step: ControlStep, *, urgent: bool) -> Exchange[Words | None]:
        """Send a control word; return the status words that came with the reply, None if it had none.

        urgent: for a word that stops the motor, see `Ask`.
        """


class Commander:
    """Commands to one drive, or to all drives at the broadcast address.

    state_timeout_s: seconds that a drive has to obey. advice: what to check when a drive does not start. answers:
    whether a drive answers at this address. fault_code: reads the code of a fault, to name it; a drive that refuses to
    return it has its fault nevertheless. busy: the codes of refusals after which a drive wants the command again.
    again: returns the status words while the effect of a step is awaited, for drives to which the step must be sent
    again for that; by default the carrier looks.
    """

    def __init__(
        self,
        profile: ControlProfile,
        carrier: WordTransport,
        *,
        state_timeout_s: float,
        advice: str = "",
        answers: bool = True,
        fault_code: Callable[[], Exchange[int | None]] | None = None,
        busy: Collection[int] = (),
        again: Callable[[ControlStep], Exchange[Words]] | None = None,
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
        """Return the status, with the code of a fault if it can be read.

        model: the meanings of the codes. seen: the status words, if they have been read already. further: other fields
        of the `DriveStatus`.
        """
        seen = seen or (yield from self._carrier.look())
        known, texts = self._profile.status(seen, **further), model.faults if model else {}
        if not known.fault or self._fault_code is None:
            return known
        code = yield from unless_refused(self._fault_code())
        return replace(known, fault_code=code, fault_text=texts.get(code, "") if code is not None else "")

    def start(self, *, reverse: bool = False, prepare: Exchange[None] | None = None) -> Exchange[None]:
        """Start the motor and wait for the effect of each step. Raises StateError if it cannot start or does not obey.

        prepare: runs before the first control word, after the check that nothing forbids a start.
        """
        profile = self._profile
        steps = profile.start_towards(reverse=reverse)
        seen = yield from self.check_start()
        if prepare is not None:
            yield from prepare
        # Steps are left out by the state before the start; the effects of earlier steps must not skip later ones.
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
                raise type(error)(f"{error}; the drive had been commanded to run before") from None

    def check_start(self) -> Exchange[Words]:
        """Return the status words of a drive that can be started. Raises StateError if its state forbids a start."""
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
        """Stop the motor by all steps of the stop; only the result of the last one counts.

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
                # The word that stops must go out even if the words that prepare it have failed.
                continue
        try:
            yield from self._carry_out(last, urgent=True)
        except _NotReachedError as error:
            raise StateError(f"the drive got the stop and does not report it: {error.shown}") from None

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault; does nothing on a drive without one. Raises StateError if the fault remains."""
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

    def _carry_out(self, step: ControlStep, *, urgent: bool) -> Exchange[Words | None]:
        """Send a step, and wait until the drive reaches the state to which it leads."""
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

    def _seen_after(self, step: ControlStep) -> Exchange[Words]:
        """Return the status words while the effect of a step is awaited.

        A drive may restart on its reset and be silent for a second or two, so some missing replies are ignored then.
        """
        patience = _RESTART_SILENCES if step in self._profile.reset else 0
        while True:
            try:
                return (yield from (self._again(step) if self._again else self._carrier.look()))
            except NoReplyError:
                if not patience:
                    raise
            patience -= 1

    def _insisted(self, step: ControlStep) -> Exchange[Words | None]:
        """Send a word that stops the motor, repeatedly while the drive is busy."""
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

    def _goal(self, step: ControlStep) -> str:
        return next((state.name for state in self._profile.states if state.known_by in step.until), "what was awaited")

    def _shown(self, step: ControlStep, seen: Words) -> str:
        word = next(iter(seen.values()))
        says = ", ".join(self._profile.status(seen).flags) or "nothing"
        return f"after 0x{step.word:04X} its status word 0x{word:04X} says: {says}"


class _NotReachedError(Exception):
    """A drive has not reached the expected state.

    shown: the state that the drive shows.
    """

    def __init__(self, shown: str) -> None:
        self.shown = shown
        super().__init__(shown)


def _any_holds(conditions: Sequence[BitCondition], seen: Words) -> bool:
    return any(condition.holds(seen) for condition in conditions)


def signed_reference(raw: int | None) -> int:
    """Return the reference that a drive shows in 16 bits, with its sign. Raises StateError if the drive shows none."""
    if raw is None:
        raise StateError(
            "no reference was set from here, and the drive does not show the one that it has from the bus, so it "
            "would start with 0; set the reference first, while the motor stands: 0 where it comes from elsewhere"
        )
    return raw - 0x10000 if raw >= 0x8000 else raw


def check_needs(needs: Mapping[str, Sequence[object]], read: Callable[[str], Exchange[Reading]]) -> Exchange[None]:
    """Raise StateError unless parameters hold the values with which a drive obeys. They are only read.

    needs: the permitted raw values, by address.
    """
    for address, allowed in needs.items():
        found = yield from read(address)
        if found.raw not in allowed:
            raise StateError(
                f"{found.name or address} is {found}, and the drive obeys the bus only with "
                f"{' or '.join(map(str, allowed))}; set it first"
            )
