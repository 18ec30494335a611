"""Starting and stopping a motor by the control word, parameter 410, and what the state word, 411, says of it.

Agile Modbus manual VEC 691 p. 70; ACT/ACU Modbus manual VEC 383 p. 72; contacts: ACT fieldbus manual 06/05 p. 41.

The control word means commands only while parameter 412 is 1. While it is 2, and perhaps with other values that no page
names, bits 0 to 5 switch the contacts S1 to S6, and which of them starts the motor is up to the drive's configuration:
0007 and 0002, which stop by the state machine, may then start it. 0000 stops in every mode, and is the only word that
switches no contact on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm import profiles
from drivecomm.errors import RefusedError, ReplyError, StateError, UnexpectedReplyError
from drivecomm_vabus import states
from drivecomm_vabus.states import profile

if TYPE_CHECKING:
    from collections.abc import Collection

    from drivecomm.profiles import Commander, Step, Words
    from drivecomm.protocol import DriveStatus, Exchange, Model, Stop
    from drivecomm_vabus.conversation import Conversation
    from drivecomm_vabus.memory import VabusMemory
    from drivecomm_vabus.references import References


class Motion:
    """The motor of one drive, or at address 32 of all."""

    def __init__(
        self,
        talk: Conversation,
        references: References,
        memory: VabusMemory,
        model: Model | None,
        *,
        state_timeout_s: float,
    ) -> None:
        self._talk = talk
        self._references = references
        self._memory = memory
        self._model = model
        self._state_timeout_s = state_timeout_s

    def state_word(self) -> Exchange[int]:
        """Read parameter 411."""
        return self._talk.number(states.STATE_WORD, "uint", "411, the state word")

    def look(self) -> Exchange[Words]:
        """Return the state word."""
        return {profiles.ONLY: (yield from self.state_word())}

    def again(self, _step: Step) -> Exchange[Words]:
        """Return the state word."""
        return self.look()

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words | None]:
        """Write the control word; its answer does not tell the state."""
        attempts = None if step.repeats else 1
        yield from self._talk.select(states.CONTROL_WORD, 0, f"{step.word:04X}", attempts=attempts, urgent=urgent)
        return None

    def status(self) -> Exchange[DriveStatus]:
        """Read the state word, and the fault code if it says fault."""
        words = yield from self.look()
        known = profile().status(words)
        if not known.fault:
            return known
        code = yield from self._fault_code()
        text = self._model.faults.get(code, "") if self._model and code is not None else ""
        return profile().status(words, fault_code=code, fault_text=text)

    def start(self, *, reverse: bool) -> Exchange[None]:
        """Give the references the sign of this direction, and walk to "operation enabled", each state awaited."""
        yield from self._commander().start(prepare=self._prepared(reverse=reverse))
        self._memory.runs = True

    def _commander(self) -> Commander:
        return profiles.Commander(
            profile(),
            self,
            state_timeout_s=self._state_timeout_s,
            advice="the hardware enable and parameter 412 (1 = state machine)",
            fault_code=self._fault_code,
        )

    def _prepared(self, *, reverse: bool) -> Exchange[None]:
        modes = yield from self._talk.held(states.LOCAL_REMOTE, "uint", "412")
        if not _by_state_machine(modes.values()):
            raise StateError(
                f"parameter 412 (Local/Remote) is {_listed(modes.values())}: only with 1, the state machine, in every "
                "data set does the control word start a motor, otherwise its bits may be contacts; write 412 = 1"
            )
        yield from self._references.turn(backwards=reverse)

    def stop(self, how: Stop) -> Exchange[None]:
        """Stop by the state machine, or by 0000 where it is not known that the state machine is in charge.

        So 412 is asked for first, unless the word is 0000 anyway. Where an earlier request is still open, which keeps
        that question waiting, a word that starts nothing in any mode goes out at once.
        """
        word = profile().stops[how][-1].word
        started_here, self._memory.runs = self._memory.runs, False
        told = self._memory.maybe_locked
        if told:
            yield self._talk.tell(states.CONTROL_WORD, f"{word if started_here else states.DISABLE_VOLTAGE:04X}")
        if word != states.DISABLE_VOLTAGE:
            try:
                modes = yield from self._talk.held(states.LOCAL_REMOTE, "uint", "412")
            except RefusedError:
                modes = {}
            except ReplyError:
                if told:
                    raise
                # It may hear and not be heard. What follows asks something first, so a late answer confirms nothing
                # else, and whoever stops it again need not wait for one.
                yield from self._talk.select(
                    states.CONTROL_WORD, 0, f"{states.DISABLE_VOLTAGE:04X}", attempts=1, nameless=False
                )
                return
            word = word if _by_state_machine(modes.values()) else states.DISABLE_VOLTAGE
        yield from self._talk.select(states.CONTROL_WORD, 0, f"{word:04X}", urgent=True)

    def stop_all(self) -> Exchange[None]:
        """Tell all drives 0000."""
        return self._talk.select(states.CONTROL_WORD, 0, f"{states.DISABLE_VOLTAGE:04X}", urgent=True)

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault with a rising edge of bit 7; does nothing on a drive without a fault."""
        try:
            yield from self._commander().reset()
        except StateError as error:
            raise StateError(f"{error}; a fault can be acknowledged only 15 s after it occurred") from None

    def command(self, word: int) -> Exchange[None]:
        """Write the control word, once: a repeated edge or start could act twice."""
        return self._talk.select(states.CONTROL_WORD, 0, f"{word:04X}", attempts=1)

    def _fault_code(self) -> Exchange[int | None]:
        try:
            return (yield from self._talk.number(states.CURRENT_FAULT, "uint", "260, the current fault"))
        except (RefusedError, UnexpectedReplyError):
            return None


def _by_state_machine(modes: Collection[int]) -> bool:
    return set(modes) == {states.STATE_MACHINE}


def _listed(modes: Collection[int]) -> str:
    if len(modes) > 1:
        return f"{', '.join(map(str, modes))} in data sets 1 to 4"
    return next(map(str, modes), "not known to the drive")
