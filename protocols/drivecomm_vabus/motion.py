"""Starting and stopping a motor by the control word, parameter 410, and what the state word, 411, says of it.

Agile Modbus manual VEC 691 p. 70; ACT/ACU Modbus manual VEC 383 p. 72; contacts: ACT fieldbus manual 06/05 p. 41.

The control word means commands only while parameter 412 is 1. While it is 2, and perhaps with other values that no page
names, bits 0 to 5 switch the contacts S1 to S6, and which of them starts the motor is up to the drive's configuration:
0007 and 0002, which stop by the state machine, may then start it. 0000 stops in every mode, and is the only word that
switches no contact on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import RefusedError, ReplyError, StateError, UnexpectedReplyError
from drivecomm.protocol import DriveState, DriveStatus, Exchange, Pause, Stop
from drivecomm_vabus import states
from drivecomm_vabus.states import State, state_of

if TYPE_CHECKING:
    from collections.abc import Collection

    from drivecomm.protocol import Model
    from drivecomm_vabus.conversation import Conversation
    from drivecomm_vabus.memory import VabusMemory
    from drivecomm_vabus.references import References

STOP_WORDS = {
    Stop.RAMP: states.DISABLE_OPERATION,
    Stop.COAST: states.DISABLE_VOLTAGE,
    Stop.QUICK: states.QUICK_STOP,
}

_MEANINGS = {
    State.NOT_READY_TO_SWITCH_ON: DriveState.NOT_READY,
    State.SWITCH_ON_DISABLED: DriveState.NOT_READY,
    State.READY_TO_SWITCH_ON: DriveState.READY,
    State.SWITCHED_ON: DriveState.READY,
    State.OPERATION_ENABLED: DriveState.RUNNING,
    State.QUICK_STOP_ACTIVE: DriveState.STOPPING,
    State.FAULT_REACTION_ACTIVE: DriveState.FAULT,
    State.FAULT: DriveState.FAULT,
}

_PATH = (
    (State.READY_TO_SWITCH_ON, states.SHUTDOWN),
    (State.SWITCHED_ON, states.SWITCH_ON),
    (State.OPERATION_ENABLED, states.ENABLE_OPERATION),
)

_POLL_S = 0.05


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

    def status(self) -> Exchange[DriveStatus]:
        """Read the state word, and the fault code if it says fault."""
        word = yield from self.state_word()
        state = state_of(word)
        faulted = state in (State.FAULT, State.FAULT_REACTION_ACTIVE)
        code = (yield from self._fault_code()) if faulted else None
        return DriveStatus(
            word=word,
            state=_MEANINGS[state] if state else DriveState.NOT_READY,
            running=state in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE),
            fault=faulted,
            warning=bool(word >> states.WARNING_BIT & 1 or word >> states.WARNING_2_BIT & 1),
            at_reference=bool(word >> states.REACHED_BIT & 1),
            remote=bool(word >> states.REMOTE_BIT & 1),
            fault_code=code,
            fault_text=self._model.faults.get(code, "") if self._model and code is not None else "",
            flags=(state.title if state else "unlisted state", *states.flags_of(word)),
        )

    def start(self, *, reverse: bool) -> Exchange[None]:
        """Give the references the sign of this direction, and walk to "operation enabled", each state awaited."""
        word = yield from self.state_word()
        state = state_of(word)
        if state in (State.FAULT, State.FAULT_REACTION_ACTIVE):
            code = yield from self._fault_code()
            raise StateError(f"the drive has a fault (code {code}) and cannot start; reset it first")
        if state is State.QUICK_STOP_ACTIVE:
            raise StateError("the drive is in a quick stop; start it again when it stands")
        modes = yield from self._talk.held(states.LOCAL_REMOTE, "uint", "412")
        if not _by_state_machine(modes.values()):
            raise StateError(
                f"parameter 412 (Local/Remote) is {_listed(modes.values())}: only with 1, the state machine, in every "
                "data set does the control word start a motor, otherwise its bits may be contacts; write 412 = 1"
            )
        yield from self._references.turn(backwards=reverse)
        for goal, control in _PATH:
            if state is None or state < goal:
                yield from self.command(control)
                try:
                    state = yield from self._await(goal, f"0x{control:04X}")
                except ReplyError as error:
                    if goal is not State.OPERATION_ENABLED:
                        raise
                    raise type(error)(f"{error}; the drive had been told to run before") from None
        self._memory.runs = True

    def stop(self, how: Stop) -> Exchange[None]:
        """Stop by the state machine, or by 0000 where it is not known that the state machine is in charge.

        So 412 is asked for first, unless the word is 0000 anyway. Where an earlier request is still open, which keeps
        that question waiting, a word that starts nothing in any mode goes out at once.
        """
        word = STOP_WORDS[how]
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
        word = yield from self.state_word()
        if state_of(word) not in (State.FAULT, State.FAULT_REACTION_ACTIVE):
            return
        yield from self.command(states.DISABLE_VOLTAGE)
        yield from self.command(states.FAULT_RESET)
        try:
            yield from self._await(State.SWITCH_ON_DISABLED, "the fault reset")
        except StateError as error:
            raise StateError(f"{error}; a fault can be acknowledged only 15 s after it occurred") from None
        # Take the bit away again, so that the next reset has an edge.
        yield from self.command(states.DISABLE_VOLTAGE)

    def command(self, word: int) -> Exchange[None]:
        """Write the control word, once: a repeated edge or start could act twice."""
        return self._talk.select(states.CONTROL_WORD, 0, f"{word:04X}", attempts=1)

    def _fault_code(self) -> Exchange[int | None]:
        try:
            return (yield from self._talk.number(states.CURRENT_FAULT, "uint", "260, the current fault"))
        except (RefusedError, UnexpectedReplyError):
            return None

    def _await(self, goal: State, cause: str) -> Exchange[State]:
        waited = 0.0
        while True:
            word = yield from self.state_word()
            if state_of(word) is goal:
                return goal
            if waited >= self._state_timeout_s:
                break
            yield Pause(seconds=_POLL_S)
            waited += _POLL_S
        raise StateError(
            f"the drive did not come to {goal.title!r} within {self._state_timeout_s:g} s after {cause}; its "
            f"state word is 0x{word:04X}; check the hardware enable and parameter 412 (1 = state machine)"
        )


def _by_state_machine(modes: Collection[int]) -> bool:
    return set(modes) == {states.STATE_MACHINE}


def _listed(modes: Collection[int]) -> str:
    if len(modes) > 1:
        return f"{', '.join(map(str, modes))} in data sets 1 to 4"
    return next(map(str, modes), "not known to the drive")
