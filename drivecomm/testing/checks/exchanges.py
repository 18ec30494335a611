"""Checks of exchange vectors: calls compared with steps on the wire, blocking and awaited, for all forms of arrival."""

from __future__ import annotations

from dataclasses import fields as dataclass_fields, replace
from decimal import Decimal
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.bus import Exchanges
from drivecomm.errors import DriveCommError, ReplyError
from drivecomm.protocol import Ask, Pause, Tell, resolve_options, with_each_command
from drivecomm.testing.calls import (
    VectorPort,
    call_awaited,
    call_blocking,
    check_call_error,
    check_call_result,
    exchange_of,
    model_of,
)
from drivecomm.testing.checking import CheckFailure, check, decoded
from drivecomm.testing.checks.telegrams import noise_of
from drivecomm.testing.live_line import live_partner
from drivecomm.testing.script import ScriptedPort, play

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from typing import TypeAlias

    from drivecomm.link import Echo
    from drivecomm.protocol import Codec, Exchange, Message, Protocol
    from drivecomm.testing.exchange_vectors import ExchangeVector, WireStep
    from drivecomm.testing.live_line import PortKind

    Face: TypeAlias = Callable[[Protocol, ExchangeVector, VectorPort], None]

# A reply that is sent immediately arrives within this time, however busy the machine is.
_PATIENT = {"reply_timeout_s": 3.0, "gap_s": 3.0}
_LONGEST_S = 0.3


@check("exchanges", "exchange")
def goes_as_written(plugin: Protocol, vector: ExchangeVector) -> None:
    """The blocking call sends, waits and returns as the vector says."""
    _play(call_blocking, plugin, vector, ScriptedPort())


@check("exchanges", "awaited", costly=True)
def goes_as_written_awaited(plugin: Protocol, vector: ExchangeVector) -> None:
    """The awaited call sends, waits and returns as the vector says."""
    _play(call_awaited, plugin, vector, ScriptedPort())


@check("exchanges", "echo", costly=True)
def goes_as_written_with_echo(plugin: Protocol, vector: ExchangeVector) -> None:
    """With an adapter that echoes everything sent, the exchange is the same."""
    _play(call_blocking, plugin, vector, ScriptedPort(echo=True), echo="expect")


@check("exchanges", "lumps", costly=True)
def goes_as_written_in_lumps(plugin: Protocol, vector: ExchangeVector) -> None:
    """With an adapter that collects the characters of a telegram before it delivers them, the exchange is the same."""
    _play(call_blocking, plugin, vector, ScriptedPort(in_lumps=True))


@check("exchanges", "another-drive")
def passes_over_another_drive(plugin: Protocol, vector: ExchangeVector) -> None:
    """With a reply of another drive in front of each reply, the exchange is the same."""
    codec = _codec(plugin, vector)
    steps: list[WireStep] = []
    asked = b""
    for step in vector.steps:
        asked = step.data if step.action == "send" else asked
        said = _of_another_drive(plugin, vector, asked, step.data) if step.action == "reply" else b""
        if said and decoded(codec, said, "reply") is not None:
            steps += [replace(step, data=said), replace(step, seconds=None)]
        else:
            steps.append(step)
    _play(call_blocking, plugin, replace(vector, steps=tuple(steps)), ScriptedPort())


@check("exchanges", "noise", costly=True)
def passes_over_noise(plugin: Protocol, vector: ExchangeVector) -> None:
    """With three characters that begin no telegram in front of each reply, the exchange is the same.

    A one-character reply gets only one of them in front: after more noise, such a character could be noise itself.
    """
    codec = _codec(plugin, vector)
    silent = noise_of(codec, "reply")
    steps: list[WireStep] = []
    for step in vector.steps:
        noise = silent[: 1 if len(step.data) == 1 else 3]
        if step.action == "reply" and noise and decoded(codec, step.data, "reply") is not None:
            steps += [replace(step, action="garbage", data=noise), replace(step, seconds=None)]
        else:
            steps.append(step)
    _play(call_blocking, plugin, replace(vector, steps=tuple(steps)), ScriptedPort())


@check("exchanges", "script")
def goes_as_written_without_a_line(plugin: Protocol, vector: ExchangeVector) -> None:
    """The operations alone, on the script runner, send and return as the vector says.

    Only for vectors in which each request has its reply: silence and damage are handled by the link, not by operations.
    """
    script = _as_script(plugin, vector)
    if script is None:
        return
    model = model_of(plugin, vector)
    options = resolve_options(plugin, model, vector.options)[1]
    memory = () if plugin.memory is None else (plugin.memory(),)
    if memory and vector.watched_s is not None:
        memory[0].watch(vector.watched_s)
    verbs = Exchanges(f"{plugin.name}:{vector.address}", plugin.operations(vector.address, options, model, *memory))
    play(_as_on_the_wire(_codec(plugin, vector), _calls_of(vector, verbs)), script)


def _as_on_the_wire(codec: Codec, exchange: Exchange[None]) -> Exchange[None]:
    """Replace each message of the exchange by its decoded wire form, in which default values are filled in."""

    def heard(command: Ask | Tell | Pause) -> Ask | Tell | Pause:
        if isinstance(command, Pause):
            return command
        return replace(command, message=codec.decode(codec.encode(command.message), "request"))

    return with_each_command(exchange, heard)


def _calls_of(vector: ExchangeVector, verbs: Exchanges) -> Exchange[None]:
    for call in vector.calls:
        try:
            result = yield from exchange_of(verbs, call)
        except DriveCommError as error:
            check_call_error(call, error)
        else:
            check_call_result(call, result)


def _as_script(plugin: Protocol, vector: ExchangeVector) -> list[tuple[Message, Message | ReplyError | None]] | None:
    """Return the steps as messages, or None if they contain more than requests and their replies."""
    codec = _codec(plugin, vector)
    script: list[tuple[Message, Message | ReplyError | None]] = []
    steps = [step for step in vector.steps if step.action != "pause_s"]
    while steps:
        send = steps.pop(0)
        request = decoded(codec, send.data, "request")
        if send.action != "send" or request is None:
            return None
        reply = None
        if steps and steps[0].action == "reply":
            reply = decoded(codec, steps.pop(0).data, "reply")
            if reply is None or plugin.mismatch(request, reply) or _is_line_error(plugin, reply):
                return None
            if any(getattr(reply, name, None) in codes for name, codes in plugin.line_errors.items()):
                return None
        script.append((request, reply))
    return script


def _is_line_error(plugin: Protocol, reply: Message) -> bool:
    return any(getattr(reply, name, None) in codes for name, codes in plugin.line_errors.items())


def _codec(plugin: Protocol, vector: ExchangeVector) -> Codec:
    return plugin.codec(resolve_options(plugin, model_of(plugin, vector), vector.options)[1])


def _of_another_drive(plugin: Protocol, vector: ExchangeVector, asked: bytes, data: bytes) -> bytes:
    """Return the reply with another address and, if possible, other content; b"" if it carries no address."""
    codec = _codec(plugin, vector)
    request, message = decoded(codec, asked, "request"), decoded(codec, data, "reply")
    if request is None or message is None or not hasattr(message, "address"):
        return b""
    others = [address for address in plugin.addresses if address not in (message.address, vector.address)]
    holder = _holder_of_the_address(message, others[0]) if others else ""
    said = _encoded(codec, message, **{holder: others[0]}) if holder else None
    if said is None or said == data:
        return b""
    other = codec.decode(said, "reply")
    # Fields that only repeat the request carry no information of the drive, so they stay.
    told = {each.name for each in dataclass_fields(message) if getattr(message, each.name) is not None}
    repeated = {name for name in told if getattr(request, name, None) == getattr(message, name)}
    for name in told - repeated - {holder, "kind"}:
        changed = _encoded(codec, other, **{name: _changed(getattr(other, name))})
        other = other if changed is None else codec.decode(changed, "reply")
    return codec.encode(other)


def _holder_of_the_address(message: Any, other: int) -> str:
    """Return the name of the field with the drive's address: `address`, or the manual's word for it; "" if none."""
    names = [each.name for each in dataclass_fields(message)]
    shows = (name for name in names if replace(message, **{name: other}).address == other)
    return "address" if "address" in names else next(shows, "")


def _changed(value: object) -> object:
    if isinstance(value, int | Decimal) and not isinstance(value, bool):
        return value + 1 if value % 2 == 0 else value - 1
    if isinstance(value, str) and value:
        return value[:-1] + ("1" if value[-1] != "1" else "2")
    return value


def _encoded(codec: Codec, message: Message, **changes: object) -> bytes | None:
    try:
        return codec.encode(replace(message, **changes))
    except DriveCommError:
        return None


def _play(face: Face, plugin: Protocol, vector: ExchangeVector, port: ScriptedPort, echo: Echo = "off") -> None:
    face(plugin, vector, VectorPort(lambda: port, partial(port.follow, vector.steps), echo))
    port.over()


@check("live", "terminal")
def goes_as_written_over_a_terminal(plugin: Protocol, vector: ExchangeVector) -> None:
    """With blocking calls over a pseudo-terminal, the exchange goes as the vector says."""
    _play_live("pty", call_blocking, plugin, vector)


@check("live", "terminal-awaited")
def goes_as_written_over_a_terminal_awaited(plugin: Protocol, vector: ExchangeVector) -> None:
    """In an event loop that watches a pseudo-terminal, the exchange goes as the vector says."""
    _play_live("pty", call_awaited, plugin, vector)


@check("live", "socket")
def goes_as_written_over_a_socket(plugin: Protocol, vector: ExchangeVector) -> None:
    """With blocking calls over TCP, the exchange goes as the vector says."""
    _play_live("tcp", call_blocking, plugin, vector)


@check("live", "thread")
def goes_as_written_in_a_thread(plugin: Protocol, vector: ExchangeVector) -> None:
    """In an event loop that waits in a thread, over RFC 2217, the exchange goes as the vector says."""
    _play_live("rfc2217", call_awaited, plugin, vector)


def sample(vectors: Iterable[ExchangeVector], number: int) -> list[ExchangeVector]:
    """Return up to this many quick vectors that do not depend on timing, spread evenly over all of them."""
    quick = [vector for vector in vectors if vector.steps and _is_quick(vector)]
    step = max(1, len(quick) // number) if number else 1
    return quick[::step][:number]


def _is_quick(vector: ExchangeVector) -> bool:
    actions = {step.action for step in vector.steps}
    if actions & {"silence", "garbage"} or any(call.expected.error for call in vector.calls):
        return False
    return sum(step.seconds or 0.0 for step in vector.steps) < _LONGEST_S


def play_at_port(kind: PortKind, face: Face, plugin: Protocol, vector: ExchangeVector) -> None:
    """Play a vector through a port of this kind. Raises CheckFailure."""
    with live_partner(kind, vector) as partner:
        try:
            face(plugin, vector, VectorPort(partner.address, partner.begin))
        except CheckFailure:
            # A failed call is mostly the consequence of a wrong request, so report that first.
            partner.check_so_far()
            raise
        partner.end()


def _play_live(kind: PortKind, face: Face, plugin: Protocol, vector: ExchangeVector) -> None:
    play_at_port(kind, face, plugin, replace(vector, options={**vector.options, **_PATIENT}))
