"""Checks of requests that affect a drive: marked as acting, sent once, never rounded, never stored unasked."""

from __future__ import annotations

from contextlib import suppress
from decimal import Decimal
from functools import partial
from typing import TYPE_CHECKING

from drivecomm.errors import DriveError, NotSupported, ReplyError, UsageError
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, expect, message_hex, raise_all
from drivecomm.testing.direct_conversation import DirectConversation

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Exchange, Framed, Model, Protocol, VirtualReply

# The number of steps of a reference that a drive holds as a share of its range.
_STEPS = 16384


@check("commands")
def what_acts_is_said_to_act(plugin: Protocol, model: Model) -> None:
    """Each request that starts, stops or resets a motor or changes its speed is sent with `acts`.

    If it gets no reply, the error can then say that the drive may have acted on it.
    """
    talk = DirectConversation(plugin, model)
    operations, able = talk.operations, talk.operations.capabilities
    verbs: list[tuple[str, Callable[[], Exchange[object]]]] = []
    for unit, (first, second) in {"percent": (40, 60), "hz": (20, 30)}.items():
        if getattr(able, f"reference_{unit}"):
            refer = getattr(operations, f"set_reference_{unit}")
            verbs += [(f"a reference in {unit}", partial(refer, first)), ("a start", operations.start)]
            verbs += [(f"a reference in {unit}", partial(refer, second)), ("a stop", operations.stop)]
    verbs += [("a start", operations.start), ("a stop", operations.stop), ("a reset", operations.reset)]
    wrong = []
    for verb, begin in verbs:
        if verb == "a reset":
            if not able.faults:
                continue
            talk.drive.trip(next(iter(model.faults), 4), talk.now)
        try:
            asked, _ = talk.over(verb, begin)
        except NotSupported:
            continue
        wrong += [
            f"{verb} sends {each.ask.message}, on which the drive acts, without acts=True"
            for each in asked
            if each.moved and not each.ask.acts
        ]
    raise_all(wrong)


@check("commands")
def a_reset_is_not_repeated(plugin: Protocol, model: Model) -> None:
    """The telegram that clears a fault is never sent twice: if its reply is lost, the reset ends in an error."""
    with bench(plugin, model) as on:
        if not on.drive.capabilities.faults:
            return
        on.virtual.trip(next(iter(model.faults), 4), on.line.time)
        on.settle()
        clearing: list[bytes] = []

        def between(find: Framed, reply: VirtualReply | None) -> VirtualReply | None:
            if not clearing and not on.virtual.motor.fault:
                clearing.append(find.data)
            return None if clearing else reply

        on.virtual.between = between
        with suppress(NotSupported, ReplyError):
            on.drive.reset()
        times = [find.data for find in on.virtual.heard].count(clearing[0]) if clearing else 0
        expect(
            times <= 1, f"{message_hex(clearing[0]) if clearing else ''} clears the fault, and is sent {times} times"
        )


@check("commands")
def rounds_no_reference(plugin: Protocol, model: Model) -> None:
    """A reference in hertz is applied to within one step of the drive's range, or refused; it is never rounded."""
    wrong = []
    for given in ("20.04", "20.004"):
        with bench(plugin, model) as on:
            if not on.drive.capabilities.reference_hz:
                return
            try:
                on.drive.set_reference(hz=Decimal(given))
                on.drive.start()
            except (UsageError, DriveError):
                continue
            on.settle()
            told_hz, most_hz = on.virtual.motor.target_hz, on.virtual.motor.maximum_hz
            if abs(told_hz - float(given)) > max(most_hz, 50.0) / _STEPS:
                wrong.append(f"a reference of {given} Hz is accepted, and the drive receives {told_hz:g} Hz")
    raise_all(wrong)


@check("parameters")
def keeps_out_of_eeprom_what_is_not_to_be_stored(plugin: Protocol, model: Model) -> None:
    """If the drive stores every write, a write without `store` is refused before anything is sent."""
    wrong = []
    with bench(plugin, model) as on:
        able = on.drive.capabilities
        if able.volatile_writes or not able.stored_writes:
            return
        for info in model.parameters.values():
            if info.access not in ("rw", "rw*") or info.kind == "command" or not isinstance(info.start, Decimal):
                continue
            try:
                on.drive.write(info.address, info.start)
            except UsageError:
                on.expect_nothing_sent(f"writing {info.address} without store is refused")
            else:
                wrong.append(f"{info.address} is written without store, and every write is stored")
                on.virtual.heard.clear()
    raise_all(wrong)
