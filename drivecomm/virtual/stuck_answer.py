"""A drive whose answers to reads of one parameter always show the same value, as with a stuck sensor.

The field of the reply that holds the value is found by trial: a change of it changes the master's reading. So this
works for every protocol whose replies carry a value as its readings show it.
"""

from __future__ import annotations

from dataclasses import fields, replace
from decimal import Decimal
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, UsageError
from drivecomm.protocol import Ask, Tell, VirtualReply, run_with_answers
from drivecomm.virtual.drives import answer_to

if TYPE_CHECKING:
    from drivecomm.protocol import Message, Reading, VirtualDrive
    from drivecomm.virtual.drives import DriveType


class StuckAnswer:
    """Fault that replaces the value in replies to reads of one parameter.

    value: a number as a master reads it, or a text equal to its `Reading.raw`. Raises UsageError if the drive does not
    have the parameter, or if its replies cannot carry this value.
    """

    def __init__(self, kind: DriveType, drive: VirtualDrive, parameter: str, value: float | str) -> None:
        self.parameter = parameter
        self._plugin = kind.plugin
        self._codec = kind.plugin.codec(kind.options)
        # New operations for each purpose, because earlier requests may change the next one.
        self._new_operations = partial(kind.plugin.operations, kind.address, kind.options, kind.model)
        self._operations = self._new_operations()
        now = drive.motor.time
        # A bad parameter must fail here, because the drive would record a refused read as an error.
        drive.peek(parameter, now)
        asked = next(self._operations.read(parameter))
        reply = answer_to(asked.message, drive, self._codec, now) if isinstance(asked, Ask) else None
        if reply is None or not isinstance(asked, Ask):
            raise UsageError(f"parameter {parameter} cannot be stuck: the drive does not answer a read of it")
        self._request, self._nameless = asked.message, asked.nameless
        self._field = self._field_of_value(reply)
        self._content = self._content_for(reply, value)

    def instead_of(self, reply: VirtualReply, request: Message | None) -> VirtualReply:
        """Return the reply to send instead of this one; the same reply if it answers another request.

        request: the request that it answers, for protocols whose replies do not show that. There a telegram that reads
        a block of parameters returns their real values.
        """
        if self._nameless and request != self._request:
            return reply
        try:
            message = self._codec.decode(reply.data, "reply")
            if self._plugin.mismatch(self._request, message) or self._field not in _names(message):
                return reply
            changed = self._codec.encode(_with(message, self._field, self._content))
        except (DriveCommError, ValueError, TypeError, ArithmeticError):
            # A refusal has no field for a value.
            return reply
        return VirtualReply(data=changed, delay_s=reply.delay_s)

    def _field_of_value(self, reply: Message) -> str:
        other = _another(self._read_from(reply).raw)
        for name in _names(reply):
            content = _in_the_form_of(getattr(reply, name), other)
            shown = None if content is None else self._shown(reply, name, content)
            if shown is not None and str(shown.raw) == str(other):
                return name
        raise UsageError(f"parameter {self.parameter} cannot be stuck: its value is not a single field of the reply")

    def _content_for(self, reply: Message, value: float | str) -> Any:
        """Return the content of the field for which a master reads this value."""
        as_it_is = _in_the_form_of(getattr(reply, self._field), str(value))
        if isinstance(value, str):
            possible = [as_it_is]
        else:
            possible = [self._interpolated(reply, value), self._written(value), as_it_is]
        for content in possible:
            shown = None if content is None else self._shown(reply, self._field, content)
            if shown is not None and _is(shown, value):
                return content
        raw = str(self._read_from(reply).raw)
        raise UsageError(
            f"parameter {self.parameter} cannot be stuck at {value!r}; "
            f"write a number that a master could read, or a raw text such as {raw!r}, its present value"
        )

    def _interpolated(self, reply: Message, value: float) -> Any:
        """Return the whole number for this value on a linear scale; None if the scale is unknown."""
        present = self._read_from(reply)
        if not isinstance(present.raw, int) or not isinstance(_single(getattr(reply, self._field)), int):
            return None
        other = int(_another(present.raw))
        shown = self._shown(reply, self._field, _in_the_form_of(getattr(reply, self._field), other))
        try:
            start, end = Decimal(present.value), Decimal(shown.value if shown is not None else present.value)
            steps = (Decimal(str(value)) - start) / (end - start)
        except ArithmeticError:
            return None
        return _in_the_form_of(getattr(reply, self._field), present.raw + round(steps * (other - present.raw)))

    def _written(self, value: float) -> Any:
        """Return the content with which a master would write this number; None if it cannot."""
        for options in ({}, {"store": True}):
            try:
                command = next(self._new_operations().write(self.parameter, Decimal(str(value)), **options))
            except DriveCommError:
                continue
            return getattr(command.message, self._field, None) if isinstance(command, Ask) else None
        return None

    def _shown(self, reply: Message, name: str, content: Any) -> Reading | None:
        """Return the master's reading if this field of the reply had another content; None if there is none."""
        try:
            changed = self._codec.encode(_with(reply, name, content))
            message = self._codec.decode(changed, "reply")
            return None if self._plugin.mismatch(self._request, message) else self._read_from(message)
        except (DriveCommError, ValueError, TypeError, ArithmeticError):
            return None

    def _read_from(self, reply: Message) -> Reading:
        """Return the master's reading of this reply."""
        replies = [reply]

        def answer(command: Ask | Tell) -> Message | None:
            if isinstance(command, Tell):
                # For example the telegram that ends a conversation.
                return None
            if not replies:
                raise UsageError(f"parameter {self.parameter} cannot be stuck: its value takes more than one reply")
            return replies.pop()

        return run_with_answers(self._operations.read(self.parameter), answer)


def _names(message: Message) -> list[str]:
    return [field.name for field in fields(message)]


def _is(reading: Reading, value: float | str) -> bool:
    return str(reading.raw) == value if isinstance(value, str) else reading.value == Decimal(str(value))


def _with(message: Message, name: str, content: Any) -> Message:
    changed: Message = replace(message, **{name: content})
    return changed


def _in_the_form_of(present: Any, raw: int | str) -> Any:
    """Return a raw value in the type of a field like this one; None if it does not fit."""
    if isinstance(present, tuple):
        only = _in_the_form_of(_single(present), raw)
        return None if only is None else (only,)
    try:
        if isinstance(present, bool):
            return None
        if isinstance(present, Decimal):
            return Decimal(raw)
        if isinstance(present, int):
            return int(raw)
    except (ValueError, ArithmeticError):
        return None
    return raw if isinstance(present, str) and isinstance(raw, str) else None


def _single(content: Any) -> Any:
    """Return the only value of a field that holds a tuple, None if it holds more; any other field unchanged."""
    if isinstance(content, tuple):
        return content[0] if len(content) == 1 else None
    return content


def _another(raw: int | str) -> int | str:
    """Return another raw value of the same form."""
    if isinstance(raw, int):
        return raw ^ 1
    if not raw:
        raise UsageError("a parameter that holds an empty text cannot be stuck")
    return raw[:-1] + ("2" if raw[-1] == "1" else "1")
