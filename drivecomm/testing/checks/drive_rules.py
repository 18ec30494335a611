"""Checks of the virtual drive's own rules: its limits, values that are not stored, the sign of a reference.

A master that knows the limits as well refuses first, so it would hide a virtual drive without limits.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, TelegramError, UsageError
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, expect, raise_all

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import Model, ParameterInfo, Protocol
    from drivecomm.testing.bench import Bench

_NEAR_HZ = 0.05
# A value that fits into every number, and not into a single bit.
_NO_COIL = 5
# Enough parameters to cover numbers of every kind.
_TRIED = 4


@check("commands")
def guards_its_limits(plugin: Protocol, model: Model) -> None:
    """A virtual drive refuses a value beyond its limits, even from a master that does not know the limits."""
    unlimited = {name: replace(info, minimum=None, maximum=None) for name, info in model.parameters.items()}
    wrong = []
    with bench(plugin, model) as on:
        drive = on.bus.drive(plugin.name, on.virtual.address, model=replace(model, parameters=unlimited))
        for info in _numbers(model):
            for value in _beyond(info):
                before = on.virtual.peek(info.address, on.line.time)
                with suppress(DriveCommError):
                    drive.write(info.address, value)
                changed = on.virtual.peek(info.address, on.line.time) != before
                if changed and drive.read(info.address).value == value:
                    limits = f"{info.minimum} to {info.maximum}"
                    wrong.append(f"{info.address} := {value} is accepted, and its limits are {limits}")
    raise_all(wrong)


@check("parameters")
def holds_only_what_it_can_tell(plugin: Protocol, model: Model) -> None:
    """A number set at the keypad of a virtual drive can be read, or is refused with ValueError when it is set."""
    wrong = []
    with bench(plugin, model) as on:
        for info in _numbers(model):
            before, place = on.virtual.peek(info.address, on.line.time), on.place
            try:
                on.virtual.poke(info.address, _NO_COIL)
            except (ValueError, DriveCommError):
                continue
            if on.place == place:
                try:
                    on.drive.read(info.address)
                except TelegramError as error:
                    wrong.append(f"{info.address} is set to {_NO_COIL}, and then the virtual drive raises {error}")
                except DriveCommError:
                    pass
            on.virtual.poke(info.address, before)
    raise_all(wrong)


@check("commands")
def forgets_what_was_not_stored(plugin: Protocol, model: Model) -> None:
    """After a power cycle, volatile writes are lost and stored writes are kept."""
    for store in (False, True):
        tried = 0
        for info in _numbers(model):
            with bench(plugin, model) as on:
                able = on.drive.capabilities
                # The contract does not require a virtual drive to support power cycles.
                has_mains = hasattr(on.virtual.inner, "power_cycle")
                if not (able.stored_writes and able.volatile_writes and has_mains):
                    return
                before = on.virtual.peek(info.address, on.line.time)
                place = on.place
                with suppress(DriveCommError):
                    on.drive.write(info.address, info.start + info.factor, store=store)  # type: ignore[operator]
                written = on.virtual.peek(info.address, on.line.time)
                if written == before or on.place != place:
                    continue
                on.virtual.power_cycle(on.line.time)
                kept = on.virtual.peek(info.address, on.line.time)
                how = "stored" if store else "written without being stored"
                wanted = written if store else before
                expect(kept == wanted, f"{info.address} is {how}, and holds {kept!r} after mains, not {wanted!r}")
                tried += 1
            if tried == _TRIED:
                break


@check("commands")
def heeds_the_sign_of_a_reference(plugin: Protocol, model: Model) -> None:
    """At a negative reference the motor turns backwards or at its lowest speed, or the reference is refused."""
    for unit, value in (("hz", 20), ("percent", 40)):
        with bench(plugin, model) as on:
            if not getattr(on.drive.capabilities, f"reference_{unit}"):
                continue
            slowest = _running_at(on, {unit: 0})
            try:
                found = _running_at(on, {unit: -value})
            except UsageError:
                continue
            expect(found <= max(slowest, 0) + _NEAR_HZ, f"at {-value} {unit} the motor turns forwards, {found:g} Hz")


def _running_at(on: Bench, reference: dict[str, int]) -> float:
    on.drive.set_reference(**reference)
    on.drive.start()
    on.settle()
    return on.virtual.motor.output_hz


def _numbers(model: Model) -> Iterator[ParameterInfo]:
    for info in model.parameters.values():
        if "w" in info.access and "r" in info.access and isinstance(info.start, Decimal):
            yield info


def _beyond(info: ParameterInfo) -> Iterator[Decimal]:
    if info.minimum is not None:
        yield info.minimum - info.factor
    if info.maximum is not None:
        yield info.maximum + info.factor
