"""Checks of parameters: the master against the virtual drive, for every parameter of a model."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, DriveError, NotSupported, UsageError
from drivecomm.testing.bench import bench
from drivecomm.testing.calls import as_data
from drivecomm.testing.checking import check, expect, raise_all

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import Model, ParameterInfo, Protocol, Reading
    from drivecomm.testing.bench import Bench

# Share of parameters that must be readable: some can only be written, or are read with an index.
_READABLE = 0.75
# Share of parameters that must keep a written value: a few are commands, which the drive carries out and discards.
_KEPT = 0.85


@check("parameters")
def reads_what_the_drive_holds(plugin: Protocol, model: Model) -> None:
    """Every parameter reads the value that the drive holds, with the name, unit and scale of the model."""
    wrong = []
    answered = 0
    with bench(plugin, model) as on:
        for info in model.parameters.values():
            try:
                reading = on.drive.read(info.address)
            except (DriveError, NotSupported):
                continue
            except DriveCommError as error:
                wrong.append(f"{info.address}: {error}")
                continue
            answered += 1
            wrong += _wrong_reading(info, reading, on)
    raise_all(wrong)
    number = sum(info.access != "w" for info in model.parameters.values())
    expect(
        answered >= _READABLE * number, f"the drive refuses to report {number - answered} of its {number} parameters"
    )


def _wrong_reading(info: ParameterInfo, reading: Reading, on: Bench) -> Iterator[str]:
    where = f"{info.address} ({info.name})"
    held = on.virtual.peek(info.address, on.line.time)
    if reading.raw != held:
        yield f"{where} reads {reading.raw!r}, the drive holds {held!r}"
    if reading.name != info.name:
        yield f"{where} is called {reading.name!r}"
    if _is_bare(info, reading):
        return
    if reading.unit != info.unit:
        yield f"{where} has the unit {reading.unit!r}, the model says {info.unit!r}"
    held_exactly = info.start is not None and (isinstance(info.start, str) or info.start % info.factor == 0)
    if info.access != "r" and held_exactly and reading.value != info.start:
        yield f"{where} reads {reading.value}, the drive started with {info.start}"
    meant = info.values.get(int(reading.value)) if isinstance(reading.value, int | Decimal) else None
    if meant is not None and info.factor == 1 and reading.text != meant:
        yield f"{where} = {reading.value} is shown as {reading.text!r}, the model says {meant!r}"


def _is_bare(info: ParameterInfo, reading: Reading) -> bool:
    """Whether a reading is a plain number without unit, with a note, because its scale is uncertain for this drive."""
    return reading.note != "" and reading.unit == "" and info.unit != ""


@check("parameters")
def is_found_by_name(plugin: Protocol, model: Model) -> None:
    """A parameter is the same by its name in the model and by its address."""
    wrong = []
    with bench(plugin, model) as on:
        for info in model.parameters.values():
            if model.find(info.name) is not info:
                continue
            try:
                by_address = on.drive.read(info.address)
            except (DriveError, NotSupported):
                continue
            by_name = on.drive.read(info.name)
            if any(getattr(by_name, each) != getattr(by_address, each) for each in ("parameter", "unit", "type")):
                wrong.append(f"{info.name} is {by_name.parameter}, {info.address} is {by_address.parameter}")
    raise_all(wrong)


@check("parameters")
def writes_what_was_given(plugin: Protocol, model: Model) -> None:
    """A written value reads back unchanged, also at the ends of its range, or the write is refused as a whole."""
    wrong: list[str] = []
    tried = kept = 0
    for info in model.parameters.values():
        if info.access == "w" or not isinstance(info.start, Decimal):
            continue
        outcomes = list(_written(plugin, model, info))
        wrong += [text for text, _ in outcomes if text]
        if info.access != "r" and outcomes:
            tried += 1
            kept += any(took for _, took in outcomes)
    raise_all(wrong)
    expect(kept >= _KEPT * tried, f"{tried - kept} of {tried} parameters do not keep a written value")


def _written(plugin: Protocol, model: Model, info: ParameterInfo) -> Iterator[tuple[str, bool]]:
    """Write some values; for each, yield the mistake in the outcome or "", and whether the drive took a new value."""
    with bench(plugin, model) as on:
        place = on.place
        for value in _values(info):
            before = on.virtual.peek(info.address, on.line.time)
            try:
                confirmed = on.write(info.address, value)
            except (UsageError, DriveError):
                continue
            except DriveCommError as error:
                if not on.answers_too_late:
                    yield f"{info.address} := {value}: {error}", False
                return
            if on.place != place:
                # The written value changed the drive's address or line settings.
                return
            if info.access == "r":
                yield f"{info.address} can only be read, and {value} was written to it", False
                continue
            after = on.virtual.peek(info.address, on.line.time)
            reading = on.drive.read(info.address)
            took = before != after and (reading.value == value or _is_bare(info, reading))
            if reading.raw != after:
                yield f"{info.address} reads {reading.raw!r}, the drive holds {after!r}", took
            else:
                yield _wrong_write(info, value, reading, confirmed, unchanged=before == after), took


def _wrong_write(
    info: ParameterInfo, value: Decimal, reading: Reading, confirmed: Reading | None, *, unchanged: bool
) -> str:
    """Return the mistake in the value read after a write, or ""; a command leaves nothing to read."""
    # For a number of unknown type the first bit may or may not be a sign; the reading has a note then.
    sign_unknown = value < 0 and not info.type and reading.note != ""
    if reading.value != value and not (unchanged or sign_unknown or _is_bare(info, reading)):
        return f"{info.address} := {value} is read back as {as_data(reading.value)}"
    if confirmed is not None and confirmed.value != value and not confirmed.note:
        return f"{info.address} := {value} is confirmed as {as_data(confirmed.value)}"
    if info.maximum is not None and value > info.maximum and not unchanged:
        return f"{info.address} := {value} is above its maximum {info.maximum}"
    if info.minimum is not None and value < info.minimum and not unchanged:
        return f"{info.address} := {value} is below its minimum {info.minimum}"
    return ""


def _values(info: ParameterInfo) -> list[Decimal]:
    """Return values that cover sign, scale and the ends of the range; the drive's start value comes last."""
    step, start = info.factor, info.start if isinstance(info.start, Decimal) else Decimal(0)
    near = {start + step, -start, *(raw * step for raw in (0, 1, 3, -1, 258, 32767, -32768, 40000, 70000))}
    for end in (info.minimum, info.maximum):
        if end is not None:
            near |= {end, end + step, end - step}
    return [*sorted(near - {start}), start]


@check("parameters")
def stores_nothing_where_it_cannot(plugin: Protocol, model: Model) -> None:
    """If no write can be stored, a write with `store` is refused before anything is sent."""
    wrong = []
    with bench(plugin, model) as on:
        if on.drive.capabilities.stored_writes:
            return
        for info in model.parameters.values():
            if info.access not in ("rw", "rw*") or not isinstance(info.start, Decimal):
                continue
            try:
                on.drive.write(info.address, info.start, store=True)
            except UsageError:
                on.expect_nothing_sent(f"storing {info.address} is refused")
            else:
                wrong.append(f"{info.address} is stored, which the capabilities exclude")
    raise_all(wrong)
