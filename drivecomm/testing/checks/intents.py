"""What a package says of its requests, held against what a virtual drive makes of them.

It decides what anybody may send again, and what a fault plan means by a reply to a read: a mistake in it is seen by no
telegram.
"""

from __future__ import annotations

from contextlib import suppress
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, TelegramError
from drivecomm.protocol import Framed, resolve_options
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, expect, shown
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Model, ParameterInfo, Protocol, VirtualReply
    from drivecomm.testing.bench import Bench


@check("commands")
def tells_asking_from_acting(plugin: Protocol, model: Model) -> None:
    """A request that only asks changes no motor and no parameter; all that reads, looks and probes only asks."""
    intent = plugin.intent
    if intent is None:
        return
    for what, find in _acting(plugin, model):
        expect(not intent(find.message).only_asks, f"{shown(find.data)} {what}, and is said to ask only")
    with bench(plugin, model) as on:
        on.drive.probe()
        on.drive.status()
        on.read_first(model)
        for find in on.virtual.heard:
            expect(intent(find.message).only_asks, f"{shown(find.data)} is sent to ask, and is said to do more")


@check("commands")
def tells_what_requests_are_for(plugin: Protocol, model: Model) -> None:
    """What reads a parameter is for reading, what changes one for writing, and what moves a motor is no reading."""
    intent = plugin.intent
    if intent is None:
        return
    for what, find in _acting(plugin, model):
        told = intent(find.message)
        fits = told.access == "write" if what == _CHANGES else told.access != "read" or told.commands
        expect(fits, f"{shown(find.data)} {what}, and is said to be a {told.access or 'command'}")
    with bench(plugin, model) as on:
        on.read_first(model)
        for find in on.virtual.heard:
            access = intent(find.message).access
            expect(access != "write", f"{shown(find.data)} is sent to read a parameter, and is said to be a write")
        expect(
            any(intent(find.message).access == "read" for find in on.virtual.heard),
            "a parameter is read, and no telegram is said to be a read",
        )


@check("commands")
def what_only_asks_moves_no_drive(plugin: Protocol, model: Model) -> None:
    """No request of the vectors that is said to ask only gives a virtual drive's motor another command."""
    intent, options = plugin.intent, resolve_options(plugin, model, {})[1]
    if intent is None:
        return
    for vector in packaged_vectors(plugin).vectors:
        address = vector.fields.get("address")
        if vector.direction != "request" or not vector.valid or vector.options:
            continue
        if not isinstance(address, int) or address not in plugin.addresses:
            # It goes to all, or it ends a conversation.
            continue
        drive = plugin.virtual(address, options, model)
        try:
            message = drive.codec.decode(vector.data, "request")
        except TelegramError:
            # It is for a drive of another variant.
            continue
        before = drive.motor.command
        drive.hear(Framed(vector.data, message), 1.0)
        now = drive.motor.command
        asks = intent(message).only_asks
        expect(not asks or now is before, f"{vector.id} is said to ask only, and tells the motor {now.value}")


_CHANGES, _MOVES, _HALTS = "changes a parameter", "makes the motor run", "stops the motor"


def _acting(plugin: Protocol, model: Model) -> list[tuple[str, Framed]]:
    """Return telegrams that change something in a virtual drive, each with what it does."""
    found: list[tuple[str, Framed]] = []
    with bench(plugin, model) as on:
        running = _watching(on, lambda: on.virtual.motor.running)
        on.drive.start()
        found += [(_MOVES, find) for find in running]
    with bench(plugin, model) as on:
        on.drive.start()
        on.settle()
        target = _watching(on, lambda: on.virtual.motor.command)
        on.drive.stop()
        found += [(_HALTS, find) for find in target]
    found += [(_CHANGES, find) for find in _changing(plugin, model)]
    return found


def _changing(plugin: Protocol, model: Model) -> list[Framed]:
    """Return the telegrams that change the first number and the first text that take a new value."""
    return [*_changing_one(plugin, model, Decimal), *_changing_one(plugin, model, str)]


def _changing_one(plugin: Protocol, model: Model, kind: type[Decimal | str]) -> list[Framed]:
    for info in model.parameters.values():
        if "w" not in info.access or not isinstance(info.start, kind):
            continue
        with bench(plugin, model) as on:
            changing = _watching(on, lambda: on.virtual.peek(info.address, on.line.time))  # noqa: B023 - used at once
            place = on.place
            for value in _others(info):
                with suppress(DriveCommError):
                    on.write(info.address, value)
            if changing and on.place == place:
                return changing
    return []


def _others(info: ParameterInfo) -> tuple[Decimal | str, ...]:
    """Return values near the one that the drive starts with; a text is as long as it was."""
    if isinstance(info.start, Decimal):
        return info.start + info.factor, info.start - info.factor
    return (f"{str(info.start)[1:]}0",)


def _watching(on: Bench, look: Callable[[], object]) -> list[Framed]:
    """Return a list that collects the telegrams after which something looks different."""
    changing: list[Framed] = []
    last = look()

    def between(find: Framed, reply: VirtualReply | None) -> VirtualReply | None:
        nonlocal last
        now = look()
        if now != last:
            last = now
            changing.append(find)
        return reply

    on.virtual.between = between
    return changing
