"""A form as two straight functions, one to read its telegram and one to write it, made from its leaves.

They know what is right. The reading one looks at what is graver first, so that the leaf which refuses is the one that
says what is wrong; where that cannot be known, and for all writing, the declared schema does it once more and says it.
That both agree is checked with every vector and with random telegrams (`drivecomm.testing.checks.schemas`).
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
from drivecomm.protocol.schema.leaves import Check

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from typing import TypeAlias

    from drivecomm.errors import Category
    from drivecomm.protocol import Message
    from drivecomm.protocol.schema.form import Form
    from drivecomm.protocol.schema.leaf import Fault

    # What computes fields of the message, by their names: a function, and the leaves that it is given.
    Reads: TypeAlias = Mapping[tuple[str, ...], tuple[Callable[..., Any], tuple[str, ...]]]

M = TypeVar("M", bound="Message")


def reader(form: Form[M]) -> Callable[[bytes], M] | None:
    """Return a function that reads a form's telegram; None where a leaf cannot be said in code.

    For bytes that are no such telegram it raises a Fault where it knows the gravest one, any other exception elsewhere.
    """
    if not _sayable(form):
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
    # What is graver is looked at first, so that it is what is found.
    for category in GRAVITY:
        found.read(category)
    _message(code, form.message, form.reads, found.values)
    return code.function("read", "data")


def writer(form: Form[M]) -> Callable[[M], bytes] | None:
    """Return a function that writes a form's telegram; None where a leaf cannot be said in code.

    It raises any exception for a message that does not fit.
    """
    if not _sayable(form):
        return None
    code = Code()
    for name, usual in form.absent.items():
        code.refuse_if(f"message.{name} != {code.refer(usual)}")
    if form.check is not None:
        code.line(f"{code.refer(form.check)}(message)")
    given = _fields(code, form)
    written = ""
    for run, sized in _runs(form.leaves, Check):
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
            if isinstance(leaf.size, Until):
                code.refuse_if(f"not {leaf.size.least} <= len({data}) <= {leaf.size.most}")
            else:
                code.refuse_if(f"len({data}) != {_size(leaf, lambda wanted: given.get(wanted, 'None'))}")
            written = _joined(code, written, data)
    code.line(f"return {written or repr(b'')}")
    return code.function("write", "message")


def measurer(form: Form[Any]) -> Callable[[bytes], int]:
    """Return a function that says how long a form's telegram is that begins so: 0 for none, more to know more."""
    if not _sayable(form):
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
    """Return the function for a telegram that has one place of unknown size, before a constant."""
    least, most, early = size.least + form.between, size.most + form.between, len(size.end) - 1
    # The constant and what follows it.
    rest = form.tail - form.between
    found = code.let(f"data.find({size.end!r}, {place} + {least})")
    code.line(f"if {found} > {place} + {most} or len(data) - {early} > {place} + {most} and {found} < 0: return 0")
    code.line(f"if {found} < 0: return max(len(data) - {early}, {place} + {least}) + {rest}")
    code.line(f"return {found} + {rest}")
    return code.function("measure", "data")


class _Place:
    """Where the next leaf begins: so many bytes behind a variable, or behind the start."""

    base, offset = "", 0

    def move_to(self, base: str) -> None:
        self.base, self.offset = base, 0

    def __str__(self) -> str:
        return f"({self.base} + {self.offset})" if self.base else str(self.offset)


class _Cut(NamedTuple):
    """The characters of a leaf: the variable that holds them, where they stand in the telegram, and how many."""

    name: str
    leaf: Any
    text: str
    place: str
    size: str


class _Found:
    """What has been cut out of a telegram, and the values of what has been read of it, by the names of the leaves."""

    def __init__(self, code: Code) -> None:
        self.values: dict[str, str] = {}
        self._code = code
        self._unread: list[_Cut] = []

    def add(self, cut: _Cut) -> None:
        self._unread.append(cut)

    def value_of(self, name: str) -> str:
        """Return a value on which the places of others depend: where it is wrong, they may be, too."""
        for cut in [cut for cut in self._unread if cut.name == name]:
            self._unread.remove(cut)
            self.values[name] = cut.leaf.emission.read(self._code, cut.text)
        return self.values.get(name, "None")

    def read(self, category: Category) -> None:
        """Read what has not been read of this category, and tell what is wrong with it."""
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
            if not isinstance(leaf, Check):
                return str(leaf.emission.read(code, cut.text))
            covered = f"data[{leaf.start} : {cut.place}]"
            wrong = f"{cut.text} != {code.refer(leaf.compute)}({covered})"
            if leaf.also is not None:
                wrong += f" and {cut.text} != {code.refer(leaf.also)}({covered})"
            code.refuse_if(wrong if leaf.off is None else f"{cut.text} != {leaf.off!r} and {wrong}")
            return cut.text


def _fault_of(name: str, leaf: Any) -> Callable[[int, int, bytes], Fault]:
    """Return what finds out what is wrong with a leaf of a size at a place."""

    def fault_at(place: int, size: int, data: bytes) -> Fault:
        fault: Fault = leaf.fault_at(place, size, data)
        fault.field = name
        return fault

    return fault_at


def _sayable(form: Form[Any]) -> bool:
    """Whether all leaves can be said in code."""
    return all(
        leaf.emission is not None and (isinstance(leaf.size, Until) or _size(leaf, str) is not None)
        for _, leaf in form.leaves
    )


def _runs(leaves: Sequence[tuple[str, Any]], *alone: type) -> Iterator[tuple[list[tuple[str, Any]], Any]]:
    """Yield leaves of fixed size that follow each other, and the one behind them that has none or stands alone."""
    run: list[tuple[str, Any]] = []
    for name, leaf in leaves:
        if leaf.emission.cut and not isinstance(leaf, alone):
            run.append((name, leaf))
        else:
            yield run, (name, leaf)
            run = []
    yield run, None


def _size(leaf: Any, value_of: Callable[[str], str]) -> Any:
    """Return a leaf's size as code, given the names of the fields before it; None for one that is no expression."""
    if isinstance(leaf.size, int):
        return str(leaf.size)
    if not isinstance(leaf.size, ExprMixin):
        return None
    return re.sub(r"this\['(\w+)'\]", lambda match: value_of(match[1]), repr(leaf.size))


def _cut_run(code: Code, run: list[tuple[str, Any]], found: _Found, place: _Place) -> None:
    """Cut leaves of fixed size out of the telegram at once."""
    if not run:
        return
    cuts = Struct(">" + "".join(leaf.emission.cut for _, leaf in run))
    texts = [f"p{place.offset}_{len(code.lines)}_{index}" for index in range(len(run))]
    code.line(f"{', '.join(texts)}, = {code.refer(cuts.unpack_from)}(data, {place})")
    for text, (name, leaf) in zip(texts, run, strict=True):
        found.add(_Cut(name, leaf, text, str(place), str(leaf.size)))
        place.offset += leaf.size


def _check_characters(code: Code, leaf: Check, value: str, written: str) -> str:
    computed = f"{code.refer(leaf.compute)}({written}[{leaf.start} :])"
    return code.let(computed if leaf.off is None else f"{leaf.off!r} if {value} == {leaf.off!r} else {computed}")


def _joined(code: Code, written: str, data: str) -> str:
    return code.let(f"{written} + {data}" if written else data)


def _fields(code: Code, form: Form[Any]) -> dict[str, str]:
    """Take the values of all leaves from the message; return their names in the code."""
    given: dict[str, str] = {}
    for names, function in form.writes.items():
        given.update(_computed(code, names, f"{code.refer(function)}(message)"))
    for name, _ in form.leaves:
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
