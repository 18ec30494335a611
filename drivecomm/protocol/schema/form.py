"""A telegram form: one flat schema and the message that its fields fill."""

from __future__ import annotations

from dataclasses import MISSING, fields
from functools import cached_property
from inspect import signature
from io import BytesIO
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from construct import Container, Struct

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import compiled
from drivecomm.protocol.schema.leaves import GRAVITY, KINDS, Fault, Leaf

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.protocol import Message


M = TypeVar("M", bound="Message")


class Form(Generic[M]):
    """One telegram: its schema, declared once, read and written by everybody.

    schema: flat Struct of leaves. message: the dataclass that its named fields fill. Where the two are not one to one:
    reads: fields of the message that are computed from leaves, by name, several separated by spaces; the function's
    parameters are named after the leaves that it needs, and it returns the value, or one for each of several names.
    writes: leaves that are computed from the message, in the same way; the function is given the message. check: raises
    TelegramError for a message whose fields do not go together, before anything is written. None of these functions may
    depend on anything but what it is given.

    Reading is strict: all bytes must be used and everything must be right. When several things are wrong, a constant
    that it does not begin with is reported before all else, length before framing, framing before checksum, and
    checksum before a field, so that noise is never called a wrong value.
    """

    def __init__(
        self,
        message: type[M],
        *leaves: Any,
        reads: Mapping[str, Callable[..., Any]] | None = None,
        writes: Mapping[str, Callable[[M], Any]] | None = None,
        check: Callable[[M], None] | None = None,
    ) -> None:
        self.message = message
        self._title = f"{message.__name__.lower()} telegram"
        self.schema = Struct(*leaves)
        self.names = frozenset(field.name for field in fields(message))
        held = {leaf.name for leaf in self.schema.subcons}
        self.absent = tuple(field.name for field in fields(message) if field.name not in held)
        """Fields of the message for which the telegram has no leaf."""
        self.reads = {
            tuple(names.split()): (function, tuple(signature(function).parameters))
            for names, function in (reads or {}).items()
        }
        self.writes = {tuple(names.split()): function for names, function in (writes or {}).items()}
        self.check = check

    def parse(self, data: bytes) -> M:
        """Return the message that these bytes carry. Raises TelegramError."""
        try:
            return self.parse_compiled(data)
        except Fault as found:
            fault = found
        except Exception:  # noqa: BLE001 - whatever it was, the declared schema finds it again and names it
            return self.parse_declared(data)
        raise self._error(fault)

    def build(self, message: M) -> bytes:
        """Return the bytes that carry this message. Raises TelegramError for a field that does not fit."""
        try:
            return self.build_compiled(message)
        except Exception:  # noqa: BLE001 - as above
            return self.build_declared(message)

    @cached_property
    def parse_compiled(self) -> Callable[[bytes], M]:
        """The schema as a straight function, `parse_declared` where there is none; raises anything for no telegram."""
        return compiled.reader(self.message, self.schema.subcons, self.reads) or self.parse_declared

    @cached_property
    def build_compiled(self) -> Callable[[M], bytes]:
        """The schema as a straight function, `build_declared` where there is none; raises anything for a misfit."""
        return compiled.writer(self.schema.subcons, self.writes, self.check) or self.build_declared

    def parse_declared(self, data: bytes) -> M:
        """Parse by the schema as it is declared. Raises TelegramError for the gravest thing that is wrong."""
        if (first := self._first_fault(data)) is not None:
            raise self._error(first)
        faults = list[Fault]()
        container, left = self._taken(data, faults)
        if left:
            faults.append(Fault("length", f"{left} characters too many"))
        if not faults:
            try:
                return self._message(container)
            except ValueError as error:
                faults.append(Fault("field", str(error)))
        # The gravest of all faults is named.
        raise self._error(min(faults, key=lambda found: GRAVITY.index(found.category)))

    def _error(self, fault: Fault) -> TelegramError:
        where = f"{self._title}, {fault.field}" if fault.field else self._title
        return TelegramError(fault.category, f"{where}: {fault}", field=fault.field)

    @cached_property
    def size(self) -> int:
        """How many characters the telegram has; 0 where that is not fixed."""
        sizes = [size for _, _, size in self._leaves or ()]
        return 0 if None in sizes else sum(size or 0 for size in sizes)

    @cached_property
    def _leaves(self) -> list[tuple[str, Leaf, int | None]] | None:
        """The leaves by name, with their sizes where these are fixed; None where a leaf reads in its own way."""
        named: list[tuple[str, Any]] = [
            (each.name or "", getattr(each, "subcon", each)) for each in self.schema.subcons
        ]
        if any(type(leaf) not in KINDS for _, leaf in named):
            return None
        return [(name, leaf, leaf.size if isinstance(leaf.size, int) else None) for name, leaf in named]

    def _first_fault(self, data: bytes) -> Fault | None:
        """Return what is told before all else: a wrong beginning, or another size than the one that it has."""
        for name, begin, size in (self._leaves or [])[:1] if data else ():
            if begin.category == "framing" and size and (fault := begin.fault_at(0, size, data)):
                fault.field = name
                return fault
        if self.size and len(data) != self.size:
            return Fault("length", f"{self.size} characters expected, {len(data) or 'nothing'} found")
        return None

    def _taken(self, data: bytes, faults: list[Fault]) -> tuple[Mapping[str, Any], int]:
        """Return what the leaves hold, None for those that are at fault, and how many characters are left."""
        if self._leaves is None:
            stream = BytesIO(data)
            container: Mapping[str, Any] = self.schema.parse_stream(stream, faults=faults)
            return container, len(data) - stream.tell()
        found: dict[str, Any] = {}
        place = 0
        for name, leaf, fixed in self._leaves:
            try:
                size = leaf.size_in(found) if fixed is None else fixed
                start, place = place, place + size
                if name:
                    found[name] = leaf.take_at(start, size, data)
                elif fault := leaf.fault_at(start, size, data):
                    faults.append(fault)
            except Fault as wrong:
                wrong.field = name
                faults.append(wrong)
                found[name] = None
        return found, max(len(data) - place, 0)

    def build_declared(self, message: M) -> bytes:
        """Build by the schema as it is declared, which alone decides what does not fit. Raises TelegramError."""
        try:
            data: bytes = self.schema.build(Container(self._fields(message)))
        except Fault as fault:
            where = f"{message.kind} telegram" + (f", {fault.field}" if fault.field else "")
            raise TelegramError("field", f"{where}: {fault}", field=fault.field) from None
        return data

    def _message(self, container: Mapping[str, Any]) -> M:
        made = {name: container[name] for name in self.names if name in container}
        for names, (function, wanted) in self.reads.items():
            made.update(_spread(names, function(*(container[name] for name in wanted))))
        return self.message(**made)

    def _fields(self, message: M) -> dict[str, Any]:
        if self.check is not None:
            self.check(message)
        computed: dict[str, Any] = {}
        for names, function in self.writes.items():
            computed.update(_spread(names, function(message)))
        own = [leaf.name for leaf in self.schema.subcons if leaf.name and leaf.name not in computed]
        return {**{name: getattr(message, name) for name in own}, **computed}

    def describe(self) -> list[tuple[str, str, str]]:
        """Return name, size and meaning of each leaf in order, for drawings of the telegram."""
        rows = []
        for leaf in self.schema.subcons:
            inner = getattr(leaf, "subcon", leaf)
            size = str(inner.size) if isinstance(inner, Leaf) and isinstance(inner.size, int) else "n"
            rows.append((leaf.name or "", size, getattr(inner, "meaning", "")))
        return rows


def _spread(names: tuple[str, ...], value: Any) -> dict[str, Any]:
    return {names[0]: value} if len(names) == 1 else dict(zip(names, value, strict=True))


def kind_of(kinds: Sequence[type[Any]], given: Mapping[str, Any]) -> type[Any]:
    """Return the dataclass of the kind of telegram that is given. Raises TelegramError."""
    for kind in kinds:
        if kind.kind == given.get("kind"):
            return kind
    raise TelegramError("field", f"the kind is one of {', '.join(kind.kind for kind in kinds)}", field="kind")


def message_of(kind: type[Any], given: Mapping[str, Any], what: str) -> Any:
    """Return a message made from fields by name; lists become tuples.

    kind: the message's dataclass. given: with or without the kind of telegram. what: how a sentence begins that says
    what is wrong with them, such as "a parameter block". Raises TelegramError for a field that is missing, or is none.
    """
    own = {field.name: field for field in fields(kind)}
    plain = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}
    content = {name: value for name, value in plain.items() if name != "kind" or name in own}
    if unknown := [name for name in content if name not in own]:
        raise TelegramError("field", f"{what} has no field {unknown[0]!r}; it has {', '.join(own)}", field=unknown[0])
    needed = [name for name, field in own.items() if field.default is MISSING and field.default_factory is MISSING]
    if missing := [name for name in needed if name not in content]:
        others = ", ".join(name for name in own if name not in needed)
        may = f"; it may also have {others}" if others else ""
        raise TelegramError("field", f"{what} also needs {', '.join(missing)}{may}", field=missing[0])
    return kind(**content)
