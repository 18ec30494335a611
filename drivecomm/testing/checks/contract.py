"""Checks of the plug-in contract: the fields of a `Protocol` object, and the rules for its operations."""

from __future__ import annotations

import dataclasses
import inspect
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, ParameterAddressError, UsageError
from drivecomm.models import model_names
from drivecomm.profiles import mistakes_in
from drivecomm.protocol import (
    LINE_FACT_NAMES,
    Ask,
    Capabilities,
    LineFacts,
    LineSettings,
    Motor,
    Pause,
    Protocol,
    Stop,
    Tell,
    installed,
    resolve_options,
)
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import CheckFailure, check, decoded, expect, known_model, raise_all, with_flips
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable


_REFERENCES = ("set_reference_percent", "set_reference_hz")
VERBS = ("read", "write", "status", "start", "stop", "reset", *_REFERENCES, "probe", "identify")

_FIELD_TYPES: dict[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("name", "title", "package", "facts_source", "default_model"), str),
    **dict.fromkeys(("addresses", "scan_addresses"), (range, tuple)),
    "facts": LineFacts,
    "broadcast_address": (int, type(None)),
    "options": type,
    "parameter_examples": tuple,
    "parameter_keys": (frozenset, type(None)),
    "silence_characters": (int, float),
    "control_keys": frozenset,
    "same_commands": bool,
    **dict.fromkeys(
        ("ambiguous_with", "factory_reading", "line_errors", "line_sources", "plain_writing", "schemes"), dict
    ),
    "unanswered": frozenset,
    "wrong_settings": str,
}


@check("contract")
def has_all_fields(plugin: Protocol) -> None:
    """Every field of the Protocol object has its type, required texts are not empty, and functions are callable."""
    wrong = []
    for field in dataclasses.fields(Protocol):
        value = getattr(plugin, field.name)
        kind = _FIELD_TYPES.get(field.name)
        if kind is None:
            if not callable(value) and not (field.default is None and value is None):
                wrong.append(f"{field.name} is not callable")
        elif not isinstance(value, kind):
            wrong.append(f"{field.name} is {value!r}")
        elif isinstance(value, str) and not value.strip() and field.default is dataclasses.MISSING:
            wrong.append(f"{field.name} is empty")
    raise_all(wrong)
    expect(installed[plugin.name] is plugin, f"another object is installed as {plugin.name}")


@check("contract")
def has_addresses(plugin: Protocol) -> None:
    """There are addresses, a scan uses only these, and the broadcast address is not one of them."""
    expect(len(plugin.addresses) > 0, "no drive has an address")
    strange = sorted(set(plugin.scan_addresses) - set(plugin.addresses))
    expect(not strange, f"a scan probes {', '.join(map(str, strange[:3]))}, where no drive can be")
    own = plugin.addresses if plugin.addresses_of is None else plugin.addresses_of(plugin.options())
    expect(own == plugin.addresses, f"addresses are {plugin.addresses}, and {own} with the options of the package")
    expect(plugin.broadcast_address not in plugin.addresses, "the broadcast address is that of a drive")


@check("contract")
def has_frozen_options(plugin: Protocol) -> None:
    """The options are a frozen, keyword-only dataclass with defaults, and share no name with a line fact."""
    kind = plugin.options
    expect(dataclasses.is_dataclass(kind), "options is not a dataclass")
    expect(kind.__dataclass_params__.frozen, "the dataclass of options is not frozen")
    for field in dataclasses.fields(kind):
        expect(field.kw_only, f"the option {field.name} can be given by position")
        expect(field.name not in LINE_FACT_NAMES, f"the option {field.name} has the name of a line fact")
    expect(kind() == kind(), "options without any given are not always the same")
    for name in model_names(plugin.package, plugin.name):
        resolve_options(plugin, known_model(plugin, name), {})


@check("contract")
def operations_are_whole(plugin: Protocol) -> None:
    """Operations have all verbs, capabilities and one address for each parameter; extra verbs have a docstring."""
    options = plugin.options()
    for address in (plugin.addresses[0], plugin.addresses[-1]):
        if plugin.memory is None:
            operations = plugin.operations(address, options, None)
        else:
            memory = plugin.memory()
            expect(callable(getattr(memory, "forget", None)), "the stored state of a drive cannot be cleared")
            memory.forget()
            operations = plugin.operations(address, options, None, memory)
        for name in (*VERBS, "address_of"):
            expect(callable(getattr(operations, name, None)), f"the operations have no {name}")
        able = operations.capabilities
        expect(isinstance(able, Capabilities), f"the capabilities are {able!r}")
        expect(not able.link_loss, "link_loss of the capabilities comes from the model: [watchdog], or its link_loss")
        expect(able.stops and able.stops <= set(Stop), f"the ways to stop are {able.stops}")
        broadcast = plugin.broadcast_address is not None
        expect(able.broadcast == broadcast, "capabilities and broadcast address contradict each other")
        for name, verb in operations.extra.items():
            expect(callable(verb), f"the verb {name} is not callable")
            expect(inspect.getdoc(verb), f"the verb {name} has no docstring")
            expect(name not in VERBS, f"the verb {name} has the name of one that every drive has")
    model = known_model(plugin, plugin.default_model)
    operations = plugin.operations(plugin.addresses[0], resolve_options(plugin, model, {})[1], model)
    addresses = [operations.address_of(info.address) for info in model.parameters.values()]
    for info, own in zip(model.parameters.values(), addresses, strict=True):
        expect(operations.address_of(info.name) == own, f"{info.name} and {info.address} have two addresses")
        expect(operations.address_of(own) == own, f"the address {own} of {info.address} has another one")
    expect(len({*addresses}) == len(addresses), "two parameters of the model have one address")


@check("contract")
def virtual_drives_are_whole(plugin: Protocol) -> None:
    """A virtual drive has its address, settings, gap, motor and codec; its parameters can be read and set directly."""
    model = known_model(plugin, plugin.default_model)
    for address in (plugin.addresses[0], plugin.addresses[-1]):
        drive = plugin.virtual(address, resolve_options(plugin, model, {})[1], model)
        expect(drive.address == address, f"a drive made for address {address} is at {drive.address}")
        expect(isinstance(drive.settings, LineSettings), f"the settings are {drive.settings!r}")
        expect(drive.gap_s > 0, f"the gap is {drive.gap_s!r} s")
        expect(isinstance(drive.motor, Motor), f"the motor is {drive.motor!r}")
        held = sum(_knows(partial(drive.peek, info.address, 0.0)) for info in model.parameters.values())
        expect(held >= len(model.parameters) / 2, f"it holds {held} of {len(model.parameters)} parameters")
        for strange in ("", "no such parameter", "-1"):
            expect(not _knows(partial(drive.peek, strange, 0.0)), f"the parameter {strange!r} is there")
            expect(not _knows(partial(drive.poke, strange, 1)), f"the parameter {strange!r} can be set")


def _knows(access: Callable[[], object]) -> bool:
    try:
        access()
    except ParameterAddressError:
        return False
    return True


@check("contract")
def finds_its_examples(plugin: Protocol) -> None:
    """The example parameter addresses of this protocol are valid parameter addresses."""
    expect(plugin.parameter_examples, "there are no examples of parameter addresses")
    operations = plugin.operations(plugin.addresses[0], plugin.options(), None)
    for parameter in plugin.parameter_examples:
        command = next(operations.read(parameter))
        expect(isinstance(command, Ask), f"reading {parameter} begins with {command}, not with a request")


@check("contract")
def can_ask_for_what_may_be_there(plugin: Protocol) -> None:
    """If a protocol lists the addresses that a drive can hold, each can be read, occurs once, and has a source."""
    if plugin.address_space is None:
        return
    options = plugin.options()
    space = plugin.address_space(options, None)
    operations = plugin.operations(plugin.addresses[0], options, None)
    expect(space.source.strip(), "the source of the possible addresses is missing")
    expect(space.absent, "no refusal code means an unknown parameter")
    seen: set[str] = set()
    for address in space.addresses():
        command = next(operations.read(address))
        expect(isinstance(command, Ask), f"reading {address} begins with {command}, not with a request")
        expect(operations.address_of(address) not in seen, f"{address} is listed twice")
        seen.add(operations.address_of(address))


@check("contract")
def refuses_what_cannot_be(plugin: Protocol) -> None:
    """An invalid parameter, value or option raises UsageError before anything is sent."""
    with bench(plugin) as on:
        drive, model = on.drive, on.drive.model
        known = next(iter(model.parameters)) if model else plugin.parameter_examples[0]
        calls: dict[str, Callable[[], Any]] = {
            "reading 'no such parameter'": lambda: drive.read("no such parameter"),
            "reading ''": lambda: drive.read(""),
            "writing 'no such parameter'": lambda: drive.write("no such parameter", 1),
            "an unknown option of read": lambda: drive.read(known, no_such_option=1),
            "an unknown option of write": lambda: drive.write(known, 1, no_such_option=1),
            "a verb that is not there": lambda: drive.call("no such verb"),
            "a reference of a million percent": lambda: drive.set_reference(percent=1_000_000),
            "a reference that is not a number": lambda: drive.set_reference(percent="fast"),
            "a reference without a unit": drive.set_reference,
        }
        for what, call in calls.items():
            try:
                call()
            except UsageError:
                on.expect_nothing_sent(f"{what} is refused")
            else:
                raise CheckFailure(f"{what} is not refused")


@check("contract")
def speaks_to_all_without_waiting(plugin: Protocol) -> None:
    """A broadcast waits for no reply, stops every motor, and no drive answers; other operations are refused."""
    if plugin.broadcast_address is None:
        return
    operations = plugin.operations(plugin.broadcast_address, plugin.options(), None)
    calls = [(name, getattr(operations, name)) for name in ("status", "start", "reset", "probe", "identify")]
    calls += [(f"a stop by {how.value}", partial(operations.stop, how)) for how in Stop]
    calls += [("a reference", partial(operations.set_reference_percent, 10))]
    calls += [("a reference in Hz", partial(operations.set_reference_hz, 10))]
    for name, begin in calls:
        try:
            commands = list(begin())
        except UsageError:
            continue
        expect(
            all(isinstance(command, Tell | Pause) for command in commands), f"{name} at all drives waits for an answer"
        )
    addresses = (plugin.addresses[0], plugin.addresses[1], plugin.addresses[-1])
    with bench(plugin, addresses=addresses) as on:
        if on.drive.capabilities.monitoring_only:
            return
        for address in addresses:
            master = on.bus.drive(plugin.name, address, model=on.drive.model)
            if master.capabilities.reference_percent:
                master.set_reference(percent=50)
            master.start()
        on.settle()
        drives = (on.virtual, *on.others)
        said = [len(each.said) for each in drives]
        on.bus.broadcast(plugin.name, model=on.drive.model).stop()
        on.settle()
        for drive, before in zip(drives, said, strict=True):
            drive.motor.advance(on.line.time)
            expect(not drive.motor.running, f"after a stop of all drives, drive {drive.address} keeps running")
            expect(not any(drive.said[before:]), f"drive {drive.address} answers the stop of all drives")


@check("contract")
def judges_every_pair(plugin: Protocol) -> None:
    """For any request and any reply, mismatch returns a text and raises nothing."""
    codec = plugin.codec(plugin.options())
    messages: dict[str, list[Any]] = {"request": [], "reply": []}
    for vector in packaged_vectors(plugin).vectors:
        if vector.valid and not vector.options:
            messages[vector.direction].append(codec.decode(vector.data, vector.direction))
    for request in messages["request"]:
        for reply in messages["reply"]:
            try:
                found = plugin.mismatch(request, reply)
            except DriveCommError as error:
                raise CheckFailure(f"asked whether {reply} answers {request}, it raises {error}") from error
            expect(isinstance(found, str), f"asked whether {reply} answers {request}, it says {found!r}")


@check("contract")
def commands_soundly(plugin: Protocol) -> None:
    """The control profiles of the protocol are valid: no stop starts a motor, and no start is sent again."""
    raise_all(
        [
            f"control profile {known.name!r}: {mistake}"
            for known in plugin.control_profiles()
            for mistake in mistakes_in(known)
        ]
    )


@check("contract")
def is_honest_about_blind_spots(plugin: Protocol) -> None:
    """In every declared blind spot, a wrong bit really goes unnoticed in some telegram."""
    declared: set[tuple[str, int, int]] = set()
    confirmed: set[tuple[str, int, int]] = set()
    codec = plugin.codec(plugin.options())
    for vector in packaged_vectors(plugin).vectors:
        if not vector.valid or vector.options:
            continue
        data, direction = vector.data, vector.direction
        for place in plugin.blind_spots(data, direction):
            key = (direction, len(data), place)
            declared.add(key)
            if any(decoded(codec, each, direction) is not None for each in with_flips(data, place)):
                confirmed.add(key)
    raise_all(
        [
            f"byte {place} of a {direction} of {length} bytes is called blind, and every wrong bit in it is noticed"
            for direction, length, place in sorted(declared - confirmed)
        ]
    )
