"""Schemas: the compiled form does what the declared one says."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING, Any

from drivecomm.conformance.case import expect, shown
from drivecomm.schema.leaves import Fault

if TYPE_CHECKING:
    from drivecomm.conformance.case import Case
    from drivecomm.conformance.forms import NamedForm
    from drivecomm.schema.form import Form


def compiles_whole(form: Form[Any]) -> None:
    """Nothing in the compiled schema calls back into the interpreter."""
    source: str = form._parser.source  # noqa: SLF001 - the compiled half has no other door
    expect("linkedparsers[" not in source, "the compiled schema calls the interpreter for a leaf")


def compiled_as_interpreted(case: Case) -> None:
    """Every form of the protocol reads the telegram, and what is left of it when cut or changed, in both ways alike."""
    data = case.vector.data
    middle = len(data) // 2
    flipped = data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]
    for named in case.forms:
        for each in (data, data[:-1], data + b"0", flipped):
            same_both_ways(named, each)


def same_both_ways(named: NamedForm, data: bytes) -> None:
    """The compiled and the interpreted schema give the same fields for these bytes, or both refuse them."""
    fast, declared = _compiled(named.form, data), _interpreted(named.form, data)
    expect(fast == declared, f"{named.name} reads {shown(data)} as {fast} compiled and as {declared} interpreted")


def _compiled(form: Form[Any], data: bytes) -> dict[str, Any] | None:
    stream = BytesIO(data)
    try:
        container = form._parser.parse_stream(stream)  # noqa: SLF001 - as above
    except Fault:
        return None
    return _fields(form, container) if stream.tell() == len(data) else None


def _interpreted(form: Form[Any], data: bytes) -> dict[str, Any] | None:
    stream = BytesIO(data)
    faults: list[Fault] = []
    container = form.schema.parse_stream(stream, faults=faults)
    return None if faults or stream.tell() != len(data) else _fields(form, container)


def _fields(form: Form[Any], container: Any) -> dict[str, Any]:
    return {leaf.name: container[leaf.name] for leaf in form.schema.subcons if leaf.name}
