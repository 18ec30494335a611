"""Checks of options: invalid values are refused, and a drive works with each valid one."""

from __future__ import annotations

import dataclasses
from inspect import signature
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, DriveError, ReplyError, UsageError
from drivecomm.protocol import choices_of, fields_of, wrong_argument
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, known_model, raise_all
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import Message, Model, Protocol

_ODD: tuple[Any, ...] = (-1, 0, 1, 2, 7, 255, 10**6, 0.5, -0.5, "", "x", True, False, None, ())
_ODD_FIELDS: tuple[Any, ...] = (*_ODD, 2**70, "\N{SNOWMAN}", ("x",), b"")


@check("contract")
def refuses_options_as_usage_errors(plugin: Protocol) -> None:
    """An invalid option of the right type raises UsageError only; a valid one makes a codec."""
    wrong = []
    for field in dataclasses.fields(plugin.options):
        for value in _ODD:
            if wrong_argument(plugin.options, {field.name: value}):
                continue
            try:
                plugin.codec(plugin.options(**{field.name: value}))
            except UsageError:
                continue
            except Exception as error:  # noqa: BLE001 - a package may raise anything, and that is the finding
                wrong.append(f"{field.name}={value!r} raises {type(error).__name__}: {error}")
    raise_all(wrong)


@check("contract")
def refuses_odd_fields_by_its_own_errors(plugin: Protocol) -> None:
    """Any value in one field of a telegram, such as text for a number, is encoded or refused with a DriveCommError."""
    wrong = []
    codec = plugin.codec(plugin.options())
    seen: set[tuple[str, str]] = set()
    for vector in packaged_vectors(plugin).vectors:
        kind = vector.direction, str(vector.fields.get("kind"))
        if not vector.valid or vector.options or kind in seen:
            continue
        seen.add(kind)
        message = codec.decode(vector.data, vector.direction)
        for given in _spoilt(message):
            try:
                codec.encode(plugin.message(given, vector.direction))
            except DriveCommError:
                continue
            except Exception as error:  # noqa: BLE001 - as above
                wrong.append(f"the fields {given} raise {type(error).__name__}: {error}")
    raise_all(wrong)


def _spoilt(message: Message) -> Iterator[dict[str, Any]]:
    """Yield the fields of a message with an odd value in one of them."""
    fields = fields_of(message)
    for name in fields.keys() - {"kind"}:
        yield from ({**fields, name: value} for value in _ODD_FIELDS)


@check("contract")
def works_with_each_option(plugin: Protocol) -> None:
    """With each value of each option that is a choice, a drive can be read, started and stopped, and has a status."""
    wrong = []
    model = known_model(plugin, plugin.default_model)
    for name, value in _choices(plugin):
        try:
            wrong += [f"with {name}={value!r} {what}" for what in _does_not_work(plugin, model, {name: value})]
        except DriveCommError as error:
            wrong.append(f"with {name}={value!r} it raises {type(error).__name__}: {error}")
    raise_all(wrong)


def _choices(plugin: Protocol) -> Iterator[tuple[str, Any]]:
    """Yield each option that is a choice of a few values, with each value that is not its default."""
    # Leave out options that are also arguments of a read, because they concern single telegrams.
    of_a_read = signature(plugin.operations(plugin.addresses[0], plugin.options(), None).read).parameters
    for name, values in choices_of(plugin.options).items():
        usual = getattr(plugin.options(), name)
        yield from ((name, value) for value in values if value != usual and name not in of_a_read)


def _does_not_work(plugin: Protocol, model: Model, options: dict[str, Any]) -> Iterator[str]:
    try:
        with bench(plugin, model, options=options) as on:
            parameter = on.read_first(model)
            if parameter:
                told, held = on.drive.read(parameter).raw, on.virtual.peek(parameter, on.line.time)
                if told != held:
                    yield f"{parameter} reads {told!r}, the drive holds {held!r}"
            on.drive.status()
            try:
                on.set_some_reference()
                on.drive.start()
            except DriveError:
                # A drive with this option may take commands in another way, or none.
                return
            on.settle()
            if not on.virtual.motor.running:
                yield "a start does not make the motor run"
            on.drive.stop()
            on.settle()
            if on.virtual.motor.running:
                yield "a stop leaves the motor running"
    except UsageError:
        # The model excludes this value of the option.
        return
    except ReplyError as error:
        yield f"the drive is not understood: {error}"
