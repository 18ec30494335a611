"""A form as two straight functions, one to read its telegram and one to write it, made from its leaves.

They know only what is right. Whatever they refuse is read or written once more by the declared schema, which says what
was wrong; so nothing depends on how or in what order they find out. That they agree with the declared schema is checked
with every vector and with random telegrams (`drivecomm.testing.schema_checks`).
"""

from __future__ import annotations

import re
from dataclasses import MISSING, fields
from struct import Struct
from typing import TYPE_CHECKING, Any, TypeVar

from construct.expr import ExprMixin

from drivecomm.protocol.schema.emission import Code
from drivecomm.protocol.schema.leaves import KINDS, Check

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from typing import TypeAlias

    from drivecomm.protocol import Message

    # What computes fields of the message, by their names: a function, and the leaves that it is given.
    Reads: TypeAlias = Mapping[tuple[str, ...], tuple[Callable[..., Any], tuple[str, ...]]]

M = TypeVar("M", bound="Message")


def reader(message: type[M], leaves: Sequence[Any], reads: Reads) -> Callable[[bytes], M] | None:
    """Return a function that reads a form's telegram; None where a leaf cannot be said in code.

    It raises any exception for bytes that are no such telegram.
    """
    if not _sayable(leaves):
        return None
    code = Code()
    found: dict[str, str] = {}
    place = _Place()
    for run, sized in _runs(leaves):
        _cut_run(code, run, found, place)
        if sized is not None:
            name, leaf = sized
            size = code.let(_size(leaf, found))
            code.refuse_if(f"{size} < 0")
            found[name] = leaf.emission.read(code, code.let(f"data[{place} : {place} + {size}]"))
            place.move_to(code.let(f"{place} + {size}"))
    code.refuse_if(f"len(data) != {place}")
    _message(code, message, reads, found)
    return code.function("read", "data")


def writer(
    leaves: Sequence[Any], writes: Mapping[tuple[str, ...], Callable[[M], Any]], check: Callable[[M], None] | None
) -> Callable[[M], bytes] | None:
    """Return a function that writes a form's telegram; None where a leaf cannot be said in code.

    It raises any exception for a message that does not fit.
    """
    if not _sayable(leaves):
        return None
    code = Code()
    if check is not None:
        code.line(f"{code.refer(check)}(message)")
    given = _fields(code, leaves, writes)
    written = ""
    for run, sized in _runs(leaves, Check):
        if run:
            cuts = "".join(leaf.emission.cut for _, leaf in run)
            values = [leaf.emission.write(code, given.get(name, "None")) for name, leaf in run]
            written = _joined(code, written, f"{code.refer(Struct(f'>{cuts}').pack)}({', '.join(values)})")
        if sized is None:
            continue
        name, leaf = sized
        value = given.get(name, "None")
        if isinstance(leaf, Check):
            written = _joined(code, written, _check_characters(code, leaf, value, written or "b''"))
        else:
            data = leaf.emission.write(code, value)
            code.refuse_if(f"len({data}) != {_size(leaf, given)}")
            written = _joined(code, written, data)
    code.line(f"return {written or repr(b'')}")
    return code.function("write", "message")


class _Place:
    """Where the next leaf begins: so many bytes behind a variable, or behind the start."""

    base, offset = "", 0

    def move_to(self, base: str) -> None:
        self.base, self.offset = base, 0

    def __str__(self) -> str:
        return f"({self.base} + {self.offset})" if self.base else str(self.offset)


def _sayable(leaves: Sequence[Any]) -> bool:
    """Whether all leaves are of our own kinds; one that overrides how it is read or written is not."""
    return all(
        type(leaf) in KINDS and leaf.emission is not None and _size(leaf, None) is not None
        for _, leaf in _named(leaves)
    )


def _named(leaves: Sequence[Any]) -> Iterator[tuple[str, Any]]:
    """Yield each leaf with its name, empty for those that have none."""
    for leaf in leaves:
        yield leaf.name or "", leaf.subcon if leaf.name and hasattr(leaf, "subcon") else leaf


def _runs(leaves: Sequence[Any], *alone: type) -> Iterator[tuple[list[tuple[str, Any]], Any]]:
    """Yield leaves of fixed size that follow each other, and the one behind them that has none or stands alone."""
    run: list[tuple[str, Any]] = []
    for name, leaf in _named(leaves):
        if leaf.emission.cut and not isinstance(leaf, alone):
            run.append((name, leaf))
        else:
            yield run, (name, leaf)
            run = []
    yield run, None


def _size(leaf: Any, found: dict[str, str] | None) -> Any:
    """Return a leaf's size as code, given the names of the fields before it; None for one that is no expression."""
    if isinstance(leaf.size, int):
        return str(leaf.size)
    if not isinstance(leaf.size, ExprMixin):
        return None
    return re.sub(r"this\['(\w+)'\]", lambda match: (found or {}).get(match[1], "None"), repr(leaf.size))


def _cut_run(code: Code, run: list[tuple[str, Any]], found: dict[str, str], place: _Place) -> None:
    """Cut leaves of fixed size out of the telegram at once, and read each."""
    if not run:
        return
    cuts = Struct(">" + "".join(leaf.emission.cut for _, leaf in run))
    names = [f"p{place.offset}_{len(code.lines)}_{index}" for index in range(len(run))]
    code.line(f"{', '.join(names)}, = {code.refer(cuts.unpack_from)}(data, {place})")
    # Constants and checks come first: most damage is found by them, before anything is made of the fields.
    fields_in_run = []
    for cut, (name, leaf) in zip(names, run, strict=True):
        if isinstance(leaf, Check):
            computed = f"{code.refer(leaf.compute)}(data[{leaf.start} : {place}])"
            wrong = f"{cut} != {computed}"
            code.refuse_if(wrong if leaf.off is None else f"{cut} != {leaf.off!r} and {wrong}")
            found[name] = cut
        elif leaf.category == "framing":
            found[name] = leaf.emission.read(code, cut)
        else:
            fields_in_run.append((cut, name, leaf))
        place.offset += leaf.size
    for cut, name, leaf in fields_in_run:
        found[name] = leaf.emission.read(code, cut)


def _check_characters(code: Code, leaf: Check, value: str, written: str) -> str:
    computed = f"{code.refer(leaf.compute)}({written}[{leaf.start} :])"
    return code.let(computed if leaf.off is None else f"{leaf.off!r} if {value} == {leaf.off!r} else {computed}")


def _joined(code: Code, written: str, data: str) -> str:
    return code.let(f"{written} + {data}" if written else data)


def _fields(
    code: Code, leaves: Sequence[Any], writes: Mapping[tuple[str, ...], Callable[[Any], Any]]
) -> dict[str, str]:
    """Take the values of all leaves from the message; return their names in the code."""
    given: dict[str, str] = {}
    for names, function in writes.items():
        given.update(_computed(code, names, f"{code.refer(function)}(message)"))
    for name, _ in _named(leaves):
        if name and name not in given:
            given[name] = code.let(f"message.{name}")
    return given


def _computed(code: Code, names: tuple[str, ...], expression: str) -> dict[str, str]:
    """Compute one value, or one for each of several names; return their names in the code."""
    computed = code.let(expression)
    if len(names) == 1:
        return {names[0]: computed}
    parts = {name: f"{computed}_{name}" for name in names}
    code.line(f"{', '.join(parts.values())} = {computed}")
    return parts


def _message(code: Code, message: type[Any], reads: Reads, found: dict[str, str]) -> None:
    """Make the message of what was found."""
    made: dict[str, str] = {}
    for names, (function, wanted) in reads.items():
        made.update(_computed(code, names, f"{code.refer(function)}({', '.join(found[name] for name in wanted)})"))
    names_of_fields = {field.name for field in fields(message)}
    made = {name: value for name, value in {**found, **made}.items() if name in names_of_fields}
    if not _plain_slots(message):
        code.line(f"return {code.refer(message)}({', '.join(f'{name}={value}' for name, value in made.items())})")
        return
    # What the generated __init__ of a frozen dataclass does, without a look-up of object.__setattr__ for each field.
    defaults = {each.name: code.refer(each.default) for each in fields(message) if each.default is not MISSING}
    made = {**defaults, **made}
    code.line(f"message = {code.refer(object.__new__)}({code.refer(message)})")
    for field in fields(message):
        setter = code.refer(getattr(message, field.name).__set__)
        code.line(f"{setter}(message, {made[field.name]})")
    code.line("return message")


def _plain_slots(message: type[Any]) -> bool:
    """Whether making one is nothing but filling its slots."""
    return (
        "__slots__" in vars(message)
        and message.__init__.__qualname__ == f"{message.__qualname__}.__init__"
        and not hasattr(message, "__post_init__")
        and "__new__" not in vars(message)
        and all(field.init and field.default_factory is MISSING for field in fields(message))
    )
