"""Compilation of a form into two straight functions, one that reads its telegram and one that writes it.

The functions accept only valid telegrams. The reading function checks graver faults first, so that the leaf that
refuses names the fault. If the gravest fault cannot be known there, and for all writing, the declared schema does the
work once more and names the fault. Tests with all vectors and with random telegrams check that both agree
(`drivecomm.testing.checks.schemas`).
"""

from __future__ import annotations

import re
from dataclasses import MISSING, fields
from struct import Struct
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from construct.expr import ExprMixin

from drivecomm.errors import UsageError
from drivecomm.protocol.schema.emission import Code
from drivecomm.protocol.schema.leaf import GRAVITY, Until
from drivecomm.protocol.schema.leaves import CheckCharacters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from typing import TypeAlias

    from drivecomm.errors import Category
    from drivecomm.protocol import Message
    from drivecomm.protocol.schema.form import Form
    from drivecomm.protocol.schema.leaf import LeafFault

    # Functions that compute fields of the message, by the names of the fields, each with the leaves that it takes.
    Reads: TypeAlias = Mapping[tuple[str, ...], tuple[Callable[..., Any], tuple[str, ...]]]

M = TypeVar("M", bound="Message")


def reader(form: Form[M]) -> Callable[[bytes], M] | None:
    """Return a function that reads a form's telegram; None if a leaf cannot be expressed in code.

    For bytes that are not such a telegram, the function raises a LeafFault if it knows the gravest one, otherwise any
    exception.
    """
    if not _is_compilable(form):
        return None
    code = Code()
    found = _Found(code)
    place = _Place()
    for run, sized in _runs(form.leaves):
        _cut_run(code, run, found, place)
        if sized is not None:
            name, leaf = sized
            if isinstance(leaf.size, Until):
                size = code.let(f"len(data) - {place} - {form.tail}")
                code.refuse_if(f"not {leaf.size.least} <= {size} <= {leaf.size.most}")
            else:
                size = code.let(_size(leaf, found.value_of))
                code.refuse_if(f"{size} < 0")
            found.add(_Cut(name, leaf, code.let(f"data[{place} : {place} + {size}]"), str(place), size))
            place.move_to(code.let(f"{place} + {size}"))
    code.refuse_if(f"len(data) != {place}")
    # Check graver faults first, so that the gravest one is found.
    for category in GRAVITY:
        found.read(category)
    _message(code, form.message, form.reads, found.values)
    return code.function("read", "data")


def writer(form: Form[M]) -> Callable[[M], bytes] | None:
    """Return a function that writes a form's telegram; None if a leaf cannot be expressed in code.

    The function raises any exception for a message that does not fit.
    """
    if not _is_compilable(form):
        return None
    code = Code()
    for name, usual in form.absent.items():
        code.refuse_if(f"message.{name} != {code.refer(usual)}")
    if form.check is not None:
        code.line(f"{code.refer(form.check)}(message)")
    given = _fields(code, form)
    written = ""
    for run, sized in _runs(form.leaves, CheckCharacters):
        if run:
            cuts = "".join(leaf.emission.cut for _, leaf in run)
            values = [leaf.emission.write(code, given.get(name, "None")) for name, leaf in run]
            written = _joined(code, written, f"{code.refer(Struct(f'>{cuts}').pack)}({', '.join(values)})")
        if sized is None:
            continue
        name, leaf = sized
        value = given.get(name, "None")
        if isinstance(leaf, CheckCharacters):
            written = _joined(code, written, _check_characters(code, leaf, value, written or "b''"))
        else:
            data = leaf.emission.write(code, value)
            if isinstance(leaf.size, Until):
                code.refuse_if(f"not {leaf.size.least} <= len({data}) <= {leaf.size.most}")
            else:
                code.refuse_if(f"len({data}) != {_size(leaf, lambda wanted: given.get(wanted, 'None'))}")
            written = _joined(code, written, data)
    code.line(f"return {written or repr(b'')}")
    return code.function("write", "message")


def measurer(form: Form[Any]) -> Callable[[bytes], int]:
    """Return a function that returns the length of a form's telegram from its first bytes.

    The result is 0 if no such telegram begins with these bytes, and more than their number if more are needed to
    measure.
    """
    if not _is_compilable(form):
        raise UsageError(f"a {form.message.__name__} has a leaf whose size is neither an expression nor `until`")
    code, place = Code(), _Place()
    values: dict[str, str] = {}
    leaves: Sequence[tuple[str, Any]] = form.leaves
    counting = " ".join(repr(leaf.size) for _, leaf in form.leaves if isinstance(leaf.size, ExprMixin))
    for name, leaf in leaves:
        if isinstance(leaf.size, Until):
            return _measured_until(code, form, leaf.size, place)
        if not isinstance(leaf.size, int):
            with code.refusing("return 0"):
                size = code.let(_size(leaf, values.__getitem__))
                code.refuse_if(f"{size} < 0")
            place.move_to(code.let(f"{place} + {size}"))
            continue
        if name and f"'{name}'" in counting:
            code.line(f"if len(data) < {place} + {leaf.size}: return {place} + {leaf.size}")
            text = code.let(f"{code.refer(Struct('>' + leaf.emission.cut).unpack_from)}(data, {place})[0]")
            with code.trying("return 0"):
                values[name] = leaf.emission.read(code, text)
        place.offset += leaf.size
    code.line(f"return {place}")
    return code.function("measure", "data")


def _measured_until(code: Code, form: Form[Any], size: Until, place: _Place) -> Callable[[bytes], int]:
    """Return the function for a telegram that has one leaf of unknown size, before a constant."""
    least, most, early = size.least + form.between, size.most + form.between, len(size.end) - 1
    # Size of the constant and of all leaves after it.
    rest = form.tail - form.between
    found = code.let(f"data.find({size.end!r}, {place} + {least})")
    code.line(f"if {found} > {place} + {most} or len(data) - {early} > {place} + {most} and {found} < 0: return 0")
    code.line(f"if {found} < 0: return max(len(data) - {early}, {place} + {least}) + {rest}")
    code.line(f"return {found} + {rest}")
    return code.function("measure", "data")


class _Place:
    """Expression for the place of the next leaf: an offset from a variable, or from the start of the telegram."""

    base, offset = "", 0

    def move_to(self, base: str) -> None:
        self.base, self.offset = base, 0

    def __str__(self) -> str:
        return f"({self.base} + {self.offset})" if self.base else str(self.offset)


class _Cut(NamedTuple):
    """Code for the characters of a leaf: the variable that holds them, their place, and their number."""

    name: str
    leaf: Any
    text: str
    place: str
    size: str


class _Found:
    """Leaves that have been cut out of a telegram, and the values that have been read, by the names of the leaves."""

    def __init__(self, code: Code) -> None:
        self.values: dict[str, str] = {}
        self._code = code
        self._unread: list[_Cut] = []

    def add(self, cut: _Cut) -> None:
        self._unread.append(cut)

    def value_of(self, name: str) -> str:
        """Return the value of a leaf on which the places of others depend.

        A wrong value raises no Fault, since the places of the other leaves may be wrong as well.
        """
        for cut in [cut for cut in self._unread if cut.name == name]:
            self._unread.remove(cut)
            self.values[name] = cut.leaf.emission.read(self._code, cut.text)
        return self.values.get(name, "None")

    def read(self, category: Category) -> None:
        """Read all unread leaves of a category, and raise their faults."""
        for cut in [cut for cut in self._unread if cut.leaf.category == category]:
            self._unread.remove(cut)
            self.values[cut.name] = self._value(cut)

    def _value(self, cut: _Cut) -> str:
        code, leaf = self._code, cut.leaf
        refusal = f"raise {code.refer(_fault_of(cut.name, leaf))}({cut.place}, {cut.size}, data)"
        if leaf.category not in ("framing", "checksum"):
            with code.trying(refusal):
                return str(leaf.emission.read(code, cut.text))
        with code.refusing(refusal):
            if not isinstance(leaf, CheckCharacters):
                return str(leaf.emission.read(code, cut.text))
            covered = f"data[{leaf.start} : {cut.place}]"
            wrong = f"{cut.text} != {code.refer(leaf.compute)}({covered})"
            if leaf.also is not None:
                wrong += f" and {cut.text} != {code.refer(leaf.also)}({covered})"
            code.refuse_if(wrong if leaf.off is None else f"{cut.text} != {leaf.off!r} and {wrong}")
            return cut.text


def _fault_of(name: str, leaf: Any) -> Callable[[int, int, bytes], LeafFault]:
    """Return a function that finds the fault of a leaf from its place, its size and the telegram."""

    def fault_at(place: int, size: int, data: bytes) -> LeafFault:
        fault: LeafFault = leaf.fault_at(place, size, data)
        fault.field = name
        return fault

    return fault_at


def _is_compilable(form: Form[Any]) -> bool:
    """Return whether all leaves can be expressed in code."""
    return all(
        leaf.emission is not None and (isinstance(leaf.size, Until) or _size(leaf, str) is not None)
        for _, leaf in form.leaves
    )


def _runs(leaves: Sequence[tuple[str, Any]], *alone: type) -> Iterator[tuple[list[tuple[str, Any]], Any]]:
    """Yield each run of leaves with a fixed size, and the leaf after it; None after the last run.

    alone: types of leaves that belong to no run although their size is fixed.
    """
    run: list[tuple[str, Any]] = []
    for name, leaf in leaves:
        if leaf.emission.cut and not isinstance(leaf, alone):
            run.append((name, leaf))
        else:
            yield run, (name, leaf)
            run = []
    yield run, None


def _size(leaf: Any, value_of: Callable[[str], str]) -> Any:
    """Return a leaf's size as code; None if it is not an expression.

    value_of: returns the code for a field before the leaf, by its name.
    """
    if isinstance(leaf.size, int):
        return str(leaf.size)
    if not isinstance(leaf.size, ExprMixin):
        return None
    return re.sub(r"this\['(\w+)'\]", lambda match: value_of(match[1]), repr(leaf.size))


def _cut_run(code: Code, run: list[tuple[str, Any]], found: _Found, place: _Place) -> None:
    """Cut a run of leaves with a fixed size out of the telegram in one statement."""
    if not run:
        return
    cuts = Struct(">" + "".join(leaf.emission.cut for _, leaf in run))
    texts = [f"p{place.offset}_{len(code.lines)}_{index}" for index in range(len(run))]
    code.line(f"{', '.join(texts)}, = {code.refer(cuts.unpack_from)}(data, {place})")
    for text, (name, leaf) in zip(texts, run, strict=True):
        found.add(_Cut(name, leaf, text, str(place), str(leaf.size)))
        place.offset += leaf.size


def _check_characters(code: Code, leaf: CheckCharacters, value: str, written: str) -> str:
    computed = f"{code.refer(leaf.compute)}({written}[{leaf.start} :])"
    return code.let(computed if leaf.off is None else f"{leaf.off!r} if {value} == {leaf.off!r} else {computed}")


def _joined(code: Code, written: str, data: str) -> str:
    return code.let(f"{written} + {data}" if written else data)


def _fields(code: Code, form: Form[Any]) -> dict[str, str]:
    """Take the values of all leaves from the message; return their variables in the code, by leaf."""
    given: dict[str, str] = {}
    for names, function in form.writes.items():
        given.update(_computed(code, names, f"{code.refer(function)}(message)"))
    for name, _ in form.leaves:
        if name and name not in given:
            given[name] = code.let(f"message.{name}")
    return given


def _computed(code: Code, names: tuple[str, ...], expression: str) -> dict[str, str]:
    """Compute one value, or one for each of several names; return the variables in the code, by name."""
    computed = code.let(expression)
    if len(names) == 1:
        return {names[0]: computed}
    parts = {name: f"{computed}_{name}" for name in names}
    code.line(f"{', '.join(parts.values())} = {computed}")
    return parts


def _message(code: Code, message: type[Any], reads: Reads, found: dict[str, str]) -> None:
    """Make the message from the values that were read."""
    made: dict[str, str] = {}
    for names, (function, wanted) in reads.items():
        made.update(_computed(code, names, f"{code.refer(function)}({', '.join(found[name] for name in wanted)})"))
    names_of_fields = {field.name for field in fields(message)}
    made = {name: value for name, value in {**found, **made}.items() if name in names_of_fields}
    if not _plain_slots(message):
        code.line(f"return {code.refer(message)}({', '.join(f'{name}={value}' for name, value in made.items())})")
        return
    # Works like the generated __init__ of a frozen dataclass, but looks up no object.__setattr__ for each field.
    defaults = {each.name: code.refer(each.default) for each in fields(message) if each.default is not MISSING}
    made = {**defaults, **made}
    code.line(f"message = {code.refer(object.__new__)}({code.refer(message)})")
    for field in fields(message):
        setter = code.refer(getattr(message, field.name).__set__)
        code.line(f"{setter}(message, {made[field.name]})")
    code.line("return message")


def _plain_slots(message: type[Any]) -> bool:
    """Return whether the constructor of a message does nothing but fill its slots."""
    return (
        "__slots__" in vars(message)
        and message.__init__.__qualname__ == f"{message.__qualname__}.__init__"
        and not hasattr(message, "__post_init__")
        and "__new__" not in vars(message)
        and all(field.init and field.default_factory is MISSING for field in fields(message))
    )
