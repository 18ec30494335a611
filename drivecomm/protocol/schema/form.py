"""Telegram forms: a flat schema, and the message that its fields fill."""

from __future__ import annotations

from dataclasses import MISSING, fields
from functools import cached_property
from inspect import signature
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from drivecomm.errors import TelegramError, UsageError
from drivecomm.protocol.schema import compiled
from drivecomm.protocol.schema.leaf import GRAVITY, Fault, Leaf, Until

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.protocol import Message


M = TypeVar("M", bound="Message")


class Form(Generic[M]):
    """One telegram form: the schema of a telegram, declared once for reading and writing.

    - leaves: in their order, named by construct's `/`.
    - message: the dataclass that the named fields fill.
    - reads: functions that compute fields of the message that do not match one leaf, by the name of the field, or by
      several names separated by spaces. The parameters of a function have the names of the leaves that it takes; it
      returns the value, or one value for each name.
    - writes: functions that compute leaves that do not match one field, by name in the same way; each takes the
      message.
    - check: raises TelegramError for a message whose fields contradict each other, before anything is written.
    - when: returns whether a message is written in this form, if several forms share a message class.

    None of these functions may depend on anything but its arguments. A field without a leaf is refused unless it has
    its default.

    Reading is strict: all bytes must be used, and all must be valid. If there are several faults, a wrong constant at
    the beginning is reported first, and so is a wrong constant after characters that a length field announces.
    Otherwise length is reported before framing, framing before checksum, and checksum before a field, so that noise is
    never reported as a wrong value.
    """

    def __init__(
        self,
        message: type[M],
        *leaves: Any,
        reads: Mapping[str, Callable[..., Any]] | None = None,
        writes: Mapping[str, Callable[[M], Any]] | None = None,
        check: Callable[[M], None] | None = None,
        when: Callable[[M], bool] | None = None,
    ) -> None:
        self.message = message
        self._title = f"{message.__name__.lower()} telegram"
        self.leaves: tuple[tuple[str, Leaf], ...] = tuple(_named(leaf) for leaf in leaves)
        """The leaves with their names; the name of a nameless leaf is empty."""
        self.names = frozenset(field.name for field in fields(message))
        self.when = when
        self.reads = {
            tuple(names.split()): (function, tuple(signature(function).parameters))
            for names, function in (reads or {}).items()
        }
        self.writes = {tuple(names.split()): function for names, function in (writes or {}).items()}
        self.check = check
        said = {name for name, _ in self.leaves}.union(*self.reads, *self.writes)
        self.absent = {
            field.name: None if field.default is MISSING else field.default
            for field in fields(message)
            if field.name not in said
        }
        """Fields of the message without a leaf in the telegram, with their defaults."""
        self.between, self.tail = _behind_until([leaf for _, leaf in self.leaves], self._title)
        """Number of characters after a leaf of size `until`: up to its constant, and in all."""

    def parse(self, data: bytes) -> M:
        """Return the message that these bytes carry. Raises TelegramError."""
        try:
            return self.parse_compiled(data)
        except Fault as found:
            fault = found
        except Exception:  # noqa: BLE001 - the declared schema repeats the work and names the fault
            return self.parse_declared(data)
        raise self._error(fault)

    def build(self, message: M) -> bytes:
        """Return the bytes that carry this message. Raises TelegramError for a field that does not fit."""
        try:
            return self.build_compiled(message)
        except Exception:  # noqa: BLE001 - the declared schema repeats the work and names the fault
            return self.build_declared(message)

    @cached_property
    def parse_compiled(self) -> Callable[[bytes], M]:
        """The compiled reader, or `parse_declared` if there is none; raises any exception for an invalid telegram."""
        return compiled.reader(self) or self.parse_declared

    @cached_property
    def build_compiled(self) -> Callable[[M], bytes]:
        """The compiled writer, or `build_declared` if there is none; raises any exception for an invalid message."""
        return compiled.writer(self) or self.build_declared

    def parse_declared(self, data: bytes) -> M:
        """Parse by the schema as it is declared. Raises TelegramError for the gravest fault."""
        if (first := self._first_fault(data)) is not None:
            raise self._error(first)
        faults = list[Fault]()
        container, left = self._taken(data, faults)
        if left:
            faults.append(Fault("length", f"{left} characters too many"))
        if not faults:
            try:
                return self._message(container)
            except TelegramError:
                raise
            except Exception as error:  # noqa: BLE001 - a function of a package rejects the value
                faults.append(Fault("field", str(error)))
        raise self._error(min(faults, key=lambda found: GRAVITY.index(found.category)))

    @property
    def kinds(self) -> Sequence[str]:
        """Kinds of its messages: the one of their class, or the possible values of the leaf named `kind`."""
        of_class = getattr(self.message, "kind", None)
        if isinstance(of_class, str):
            return [of_class]
        return [str(kind) for name, leaf in self.leaves if name == "kind" for kind in (leaf.words or {}).values()] or [
            ""
        ]

    def writes_as_it_is(self, name: str) -> bool:
        """Return whether the leaf of this name is written straight from the message's field of the same name."""
        return name in self.names and not any(name in names for names in self.writes)

    def _error(self, fault: Fault) -> TelegramError:
        where = f"{self._title}, {fault.field}" if fault.field else self._title
        return TelegramError(fault.category, f"{where}: {fault}", field=fault.field)

    @cached_property
    def size(self) -> int:
        """Number of characters in the telegram; 0 if it is not fixed."""
        sizes = [leaf.size for _, leaf in self.leaves]
        return sum(sizes) if all(isinstance(size, int) for size in sizes) else 0

    def _first_fault(self, data: bytes) -> Fault | None:
        """Return the fault that is reported before all others: a wrong beginning, or a wrong size of the telegram."""
        for name, begin in self.leaves[:1] if data else ():
            if begin.category == "framing" and (fault := begin.fault_at(0, begin.size, data)):
                fault.field = name
                return fault
        if self.size and len(data) != self.size:
            return Fault("length", f"{self.size} characters expected, {len(data) or 'nothing'} found")
        return None

    def _taken(self, data: bytes, faults: list[Fault]) -> tuple[Mapping[str, Any], int]:
        """Return the values of the leaves, None for faulty ones, and the number of characters that are left.

        faults: the list to which faults are added.
        """
        found: dict[str, Any] = {}
        place, counted = 0, False
        for name, leaf in self.leaves:
            try:
                size = leaf.size
                if sized := type(size) is not int:
                    size = leaf.size_in(found, len(data) - place - self.tail)
                start, place = place, place + size
                announced, counted = counted, sized
                if name:
                    found[name] = leaf.take_at(start, size, data)
                elif fault := leaf.fault_at(start, size, data):
                    if announced and leaf.category == "framing":
                        # All announced characters are there, but the constant after them is wrong.
                        faults[:] = [each for each in faults if each.category == "framing"]
                        faults.append(Fault("framing", str(fault)))
                        return found, 0
                    faults.append(fault)
            except Fault as wrong:
                wrong.field, counted = name, counted and wrong.category != "length"
                faults.append(wrong)
                found[name] = None
        return found, max(len(data) - place, 0)

    def build_declared(self, message: M) -> bytes:
        """Build by the leaves as they are declared, which alone decide which values fit. Raises TelegramError."""
        values, data, name = self._fields(message), b"", ""
        try:
            for name, leaf in self.leaves:
                data += leaf.write_behind(data, values.get(name), values)
        except Fault as fault:
            where = f"{message.kind} telegram" + (f", {name}" if name else "")
            raise TelegramError("field", f"{where}: {fault}", field=name) from None
        return data

    def _message(self, container: Mapping[str, Any]) -> M:
        made = {name: container[name] for name in self.names if name in container}
        for names, (function, wanted) in self.reads.items():
            made.update(_spread(names, function(*(container[name] for name in wanted))))
        return self.message(**made)

    def _fields(self, message: M) -> dict[str, Any]:
        for name, usual in self.absent.items():
            if getattr(message, name) != usual:
                raise TelegramError("field", f"this {message.kind} telegram has no {name}", field=name)
        computed: dict[str, Any] = {}
        try:
            if self.check is not None:
                self.check(message)
            for names, function in self.writes.items():
                computed.update(_spread(names, function(message)))
        except TelegramError:
            raise
        except Exception as error:
            raise TelegramError("field", f"{message.kind} telegram: {error}") from error
        own = [name for name, _ in self.leaves if name and name not in computed]
        try:
            return {**{name: getattr(message, name) for name in own}, **computed}
        except AttributeError as error:
            # The message is of a class that several forms share, but has the fields of none of them.
            raise TelegramError("field", f"{message.kind} telegram: {error}") from error

    def describe(self) -> list[tuple[str, str, str]]:
        """Return name, size and meaning of each leaf in order, for drawings of the telegram."""
        return [
            (name, str(leaf.size) if isinstance(leaf.size, int) else "n", leaf.meaning) for name, leaf in self.leaves
        ]


def _behind_until(leaves: Sequence[Leaf], title: str) -> tuple[int, int]:
    """Return the number of characters after a leaf of size `until`: up to its constant, and in all."""
    until = next((leaf for leaf in leaves if isinstance(leaf.size, Until)), None)
    if until is None:
        return 0, 0
    behind, end = leaves[leaves.index(until) + 1 :], until.size.end
    if not all(isinstance(leaf.size, int) for leaf in behind):
        raise UsageError(f"{title}: all that stands behind {until.meaning!r}, which has no size of its own, has one")
    place = next((place for place, leaf in enumerate(behind) if leaf.words == {end: None}), None)
    if place is None:
        raise UsageError(f"{title}: the constant {end.hex(' ').upper()} is missing that ends {until.meaning!r}")
    for leaf in behind[:place]:
        if any(set(end).intersection(each) for each in leaf.alphabets):
            raise UsageError(f"{title}: {leaf.meaning!r} may hold {end.hex(' ').upper()}, which ends what is before it")
    return sum(leaf.size for leaf in behind[:place]), sum(leaf.size for leaf in behind)


def _named(leaf: Any) -> tuple[str, Leaf]:
    """Return the name and the leaf of a part; the name may be empty. Raises UsageError for anything but a leaf."""
    inner = getattr(leaf, "subcon", leaf)
    if not isinstance(inner, Leaf):
        raise UsageError(f"{leaf!r} is not a leaf; make one with the functions of drivecomm.protocol.schema, or a Leaf")
    return leaf.name or "", inner


def _spread(names: tuple[str, ...], value: Any) -> dict[str, Any]:
    return {names[0]: value} if len(names) == 1 else dict(zip(names, value, strict=True))


def kind_of(kinds: Sequence[type[Any]], given: Mapping[str, Any]) -> type[Any]:
    """Return the dataclass for the kind of telegram in these fields. Raises TelegramError for an unknown kind."""
    for kind in kinds:
        if kind.kind == given.get("kind"):
            return kind
    raise TelegramError("field", f"the kind is one of {', '.join(kind.kind for kind in kinds)}", field="kind")


def message_of(kind: type[Any], given: Mapping[str, Any], what: str) -> Any:
    """Return a message made from fields by name; lists become tuples.

    kind: the message's dataclass. given: with or without the kind of telegram. what: the subject of an error sentence,
    such as "a parameter block". Raises TelegramError for a missing or an unknown field.
    """
    own = {field.metadata.get("shown", field.name): field for field in fields(kind)}
    plain = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}
    content = {name: value for name, value in plain.items() if name != "kind" or name in own}
    if unknown := [name for name in content if name not in own]:
        raise TelegramError("field", f"{what} has no field {unknown[0]!r}; it has {', '.join(own)}", field=unknown[0])
    needed = [name for name, field in own.items() if field.default is MISSING and field.default_factory is MISSING]
    if missing := [name for name in needed if name not in content]:
        others = ", ".join(name for name in own if name not in needed)
        may = f"; it may also have {others}" if others else ""
        raise TelegramError("field", f"{what} also needs {', '.join(missing)}{may}", field=missing[0])
    return kind(**{own[shown].name: value for shown, value in content.items()})
