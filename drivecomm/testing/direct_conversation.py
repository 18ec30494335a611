"""A master's operations and a virtual drive without a line between them: all requests with their replies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.errors import DriveCommError, NoReplyError
from drivecomm.protocol import Ask, Framed, Pause, resolve_options, run_with_answers, with_each_command

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Exchange, Message, Model, Operations, Protocol, Tell, VirtualDrive

# Longer than a drive needs to store a value.
_BETWEEN_S = 5.0


class AnsweredRequest(NamedTuple):
    """A request and its reply.

    verb: the operation that sent the request. moved: whether the request changed the motor's command, fault or target
    frequency.
    """

    verb: str
    ask: Ask
    answer: Message
    moved: bool


@dataclass
class DirectConversation:
    """A master's operations and their virtual drive. now: the drive's time in seconds."""

    plugin: Protocol
    model: Model
    operations: Operations = field(init=False)
    drive: VirtualDrive = field(init=False)
    now: float = 1.0

    def __post_init__(self) -> None:
        plugin = self.plugin
        options = resolve_options(plugin, self.model, {})[1]
        memory = () if plugin.memory is None else (plugin.memory(),)
        self.operations = plugin.operations(plugin.addresses[0], options, self.model, *memory)
        self.drive = plugin.virtual(plugin.addresses[0], options, self.model)

    def over(self, verb: str, begin: Callable[[], Exchange[object]]) -> tuple[list[AnsweredRequest], bool]:
        """Run an exchange; return its requests with their replies, and whether it completed without an error."""
        pairs: list[AnsweredRequest] = []

        def passing(command: Ask | Tell | Pause) -> Ask | Tell | Pause:
            self.now += command.seconds if isinstance(command, Pause) else _BETWEEN_S
            return command

        def answer(command: Ask | Tell) -> Message | None:
            data = self.drive.codec.encode(command.message)
            self.drive.motor.advance(self.now)
            before = self._commanded()
            said = self.drive.hear(Framed(data, self.drive.codec.decode(data, "request")), self.now)
            if not isinstance(command, Ask):
                return None
            if said is None:
                raise NoReplyError("the virtual drive is silent")
            reply = self.drive.codec.decode(said.data, "reply")
            pairs.append(AnsweredRequest(verb, command, reply, before != self._commanded()))
            return reply

        try:
            run_with_answers(with_each_command(begin(), passing), answer)
        except DriveCommError:
            return pairs, False
        return pairs, True

    def _commanded(self) -> tuple[object, ...]:
        motor = self.drive.motor
        return motor.command, motor.fault, motor.target_hz
