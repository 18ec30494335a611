"""A telegram form: one flat schema and the message that its fields fill."""

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
    """One telegram: its schema, declared once, read and written by everybody.

    leaves: in their order, named by construct's `/`. message: the dataclass that its named fields fill. Where the two
    are not one to one: reads: fields of the message that are computed from leaves, by name, several separated by
    spaces; the function's parameters are named after the leaves that it needs, and it returns the value, or one for
    each of several names. writes: leaves that are computed from the message, in the same way; the function is given the
    message. check: raises TelegramError for a message whose fields do not go together, before anything is written.
    when: which messages are written so, where several forms share a class of messages. None of these functions may
    depend on anything but what it is given. A field for which there is no leaf is refused unless it has its default.

    Reading is strict: all bytes must be used and everything must be right. When several things are wrong, a constant
    that it does not begin with is reported before all else, and so is a constant behind characters that a length field
    announces; then length before framing, framing before checksum, and checksum before a field, so that noise is never
    called a wrong value.
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
        """The leaves with their names, empty for those that have none."""
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
        """Fields of the message for which the telegram has no leaf, with their defaults."""
        self.between, self.tail = _behind_until([leaf for _, leaf in self.leaves], self._title)
        """How many characters stand behind a leaf that reaches until a constant: before that, and in all."""

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
        return compiled.reader(self) or self.parse_declared

    @cached_property
    def build_compiled(self) -> Callable[[M], bytes]:
        """The schema as a straight function, `build_declared` where there is none; raises anything for a misfit."""
        return compiled.writer(self) or self.build_declared

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
            except TelegramError:
                raise
            except Exception as error:  # noqa: BLE001 - a function of a package that takes no such value
                faults.append(Fault("field", str(error)))
        # The gravest of all faults is named.
        raise self._error(min(faults, key=lambda found: GRAVITY.index(found.category)))

    @property
    def kinds(self) -> Sequence[str]:
        """The kinds of its messages: the one of their class, or those of the leaf that is called so."""
        of_class = getattr(self.message, "kind", None)
        if isinstance(of_class, str):
            return [of_class]
        return [str(kind) for name, leaf in self.leaves if name == "kind" for kind in (leaf.words or {}).values()] or [
            ""
        ]

    def writes_as_it_is(self, name: str) -> bool:
        """Whether a leaf of this name is written as the message has it."""
        return name in self.names and not any(name in names for names in self.writes)

    def _error(self, fault: Fault) -> TelegramError:
        where = f"{self._title}, {fault.field}" if fault.field else self._title
        return TelegramError(fault.category, f"{where}: {fault}", field=fault.field)

    @cached_property
    def size(self) -> int:
        """How many characters the telegram has; 0 where that is not fixed."""
        sizes = [leaf.size for _, leaf in self.leaves]
        return sum(sizes) if all(isinstance(size, int) for size in sizes) else 0

    def _first_fault(self, data: bytes) -> Fault | None:
        """Return what is told before all else: a wrong beginning, or another size than the one that it has."""
        for name, begin in self.leaves[:1] if data else ():
            if begin.category == "framing" and (fault := begin.fault_at(0, begin.size, data)):
                fault.field = name
                return fault
        if self.size and len(data) != self.size:
            return Fault("length", f"{self.size} characters expected, {len(data) or 'nothing'} found")
        return None

    def _taken(self, data: bytes, faults: list[Fault]) -> tuple[Mapping[str, Any], int]:
        """Return what the leaves hold, None for those that are at fault, and how many characters are left."""
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
                        # What was announced is all there, and then another character than has to follow.
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
        """Build by the leaves as they are declared, which alone decide what does not fit. Raises TelegramError."""
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
            # A message of a class that several forms share, with the fields of none of them.
            raise TelegramError("field", f"{message.kind} telegram: {error}") from error

    def describe(self) -> list[tuple[str, str, str]]:
        """Return name, size and meaning of each leaf in order, for drawings of the telegram."""
        return [
            (name, str(leaf.size) if isinstance(leaf.size, int) else "n", leaf.meaning) for name, leaf in self.leaves
        ]


def _behind_until(leaves: Sequence[Leaf], title: str) -> tuple[int, int]:
    """Return how many characters stand behind a leaf of size `until`: before its constant, and in all."""
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
    """Return a leaf that is declared with a name or without one. Raises UsageError for anything else."""
    inner = getattr(leaf, "subcon", leaf)
    if not isinstance(inner, Leaf):
        raise UsageError(f"{leaf!r} is not a leaf; make one with the functions of drivecomm.protocol.schema, or a Leaf")
    return leaf.name or "", inner


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
