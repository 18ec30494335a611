"""Control word (parameter 410), state word (parameter 411) and the state machine between them.

Agile Modbus manual VEC 691 p. 70; ACT/ACU Modbus manual VEC 383 p. 72; further bits ACU CM-CAN manual p. 167.
"""

from __future__ import annotations

from enum import IntEnum

CONTROL_WORD = 410
STATE_WORD = 411
LOCAL_REMOTE = 412
CURRENT_FAULT = 260

STATE_MACHINE = 1
"""Parameter 412: the control word commands; with 2 its bits 0 to 5 are contacts, other values are in no page."""

SHUTDOWN = 0x0006
SWITCH_ON = 0x0007
ENABLE_OPERATION = 0x000F
DISABLE_OPERATION = 0x0007
DISABLE_VOLTAGE = 0x0000
QUICK_STOP = 0x0002
FAULT_RESET = 0x0080


class State(IntEnum):
    """The eight states of the state machine, by their number in the manuals."""

    NOT_READY_TO_SWITCH_ON = 1
    SWITCH_ON_DISABLED = 2
    READY_TO_SWITCH_ON = 3
    SWITCHED_ON = 4
    OPERATION_ENABLED = 5
    QUICK_STOP_ACTIVE = 6
    FAULT_REACTION_ACTIVE = 7
    FAULT = 8

    @property
    def title(self) -> str:
        """The state in the manual's words."""
        return self.name.replace("_", " ").lower()


STATE_BITS: dict[State, tuple[int, int]] = {
    State.NOT_READY_TO_SWITCH_ON: (0x4F, 0x00),
    State.SWITCH_ON_DISABLED: (0x4F, 0x40),
    State.READY_TO_SWITCH_ON: (0x6F, 0x21),
    State.SWITCHED_ON: (0x6F, 0x23),
    State.OPERATION_ENABLED: (0x6F, 0x27),
    State.QUICK_STOP_ACTIVE: (0x6F, 0x07),
    State.FAULT_REACTION_ACTIVE: (0x4F, 0x0F),
    State.FAULT: (0x4F, 0x08),
}
"""Mask and value of each state in the state word; bit 4 is masked out, the manuals contradict each other about it."""

VOLTAGE_BIT, WARNING_BIT, REMOTE_BIT, REACHED_BIT, LIMIT_BIT, WARNING_2_BIT = 4, 7, 9, 10, 11, 15

FLAGS = {
    VOLTAGE_BIT: "voltage enabled",
    WARNING_BIT: "warning",
    REMOTE_BIT: "remote",
    REACHED_BIT: "reference reached",
    LIMIT_BIT: "internal limit active",
    WARNING_2_BIT: "warning 2",
}


def state_of(word: int) -> State | None:
    """Return the state that a state word means, None for a pattern that the manuals do not list."""
    return next((state for state, (mask, value) in STATE_BITS.items() if word & mask == value), None)


def flags_of(word: int) -> tuple[str, ...]:
    """Return the names of the set bits beyond the state itself."""
    return tuple(name for bit, name in FLAGS.items() if word >> bit & 1)


_RUN = frozenset([State.READY_TO_SWITCH_ON, State.SWITCHED_ON, State.OPERATION_ENABLED])


def next_state(state: State, control: int, *, previous: int) -> State:
    """Return the state that a control word leads to, by the transitions of section 13.3 of the specification.

    previous: the control word before, for the edge of the fault reset. One step at a time: a drive applies it until
    nothing changes.
    """
    if state is State.FAULT:
        return State.SWITCH_ON_DISABLED if control & 0x80 and not previous & 0x80 else state
    enable_voltage, quick_stop = control & 0x02, not control & 0x04
    if not enable_voltage or (quick_stop and state in (State.READY_TO_SWITCH_ON, State.SWITCHED_ON)):
        disabled = state in _RUN or state is State.QUICK_STOP_ACTIVE
        return State.SWITCH_ON_DISABLED if disabled else state
    if quick_stop:
        return State.QUICK_STOP_ACTIVE if state is State.OPERATION_ENABLED else state
    if not control & 0x01:
        ready = state in _RUN or state is State.SWITCH_ON_DISABLED
        return State.READY_TO_SWITCH_ON if ready else state
    if control & 0x08:
        return State.OPERATION_ENABLED if state in _RUN else state
    return State.SWITCHED_ON if state in _RUN else state
