"""A telegram form: one flat schema and the message that its fields fill."""

from __future__ import annotations

from dataclasses import fields
from functools import cached_property
from io import BytesIO
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from construct import Container, Struct

from drivecomm.errors import Category, TelegramError
from drivecomm.schema.leaves import Fault, Leaf

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.telegram import Message

M = TypeVar("M", bound="Message")

_RANK: dict[Category, int] = {"length": 0, "framing": 1, "checksum": 2, "field": 3}


class Form(Generic[M]):
    """One telegram: its schema, declared once, read and written by everybody.

    schema: flat Struct of leaves. message: the dataclass that its named fields fill. unpack and pack: where the fields
    of the schema are not those of the message one to one, functions from schema fields to the message's keyword
    arguments and from the message to schema fields.

    Reading is strict: all bytes must be used and everything must be right. When several things are wrong, length is
    reported before framing, framing before checksum, and checksum before a field, so that noise is never called a
    wrong value.
    """

    def __init__(
        self,
        message: type[M],
        *leaves: Any,
        unpack: Callable[[Mapping[str, Any]], dict[str, Any]] | None = None,
        pack: Callable[[M], dict[str, Any]] | None = None,
    ) -> None:
        self.message = message
        self.schema = Struct(*leaves)
        self._names = tuple(field.name for field in fields(message))
        self._unpack = unpack or self._same_names
        self._pack = pack or self._attributes

    def parse(self, data: bytes) -> M:
        """Return the message that these bytes carry. Raises TelegramError."""
        stream = BytesIO(data)
        try:
            container = self._parser.parse_stream(stream)
            if stream.tell() != len(data):
                raise Fault("length", f"{len(data) - stream.tell()} characters too many")  # noqa: TRY301
            return self.message(**self._unpack(container))
        except (Fault, ValueError) as error:
            raise self._explain(data, error) from None

    def build(self, message: M) -> bytes:
        """Return the bytes that carry this message. Raises TelegramError for a field that does not fit."""
        try:
            data: bytes = self.schema.build(Container(self._pack(message)))
        except Fault as fault:
            where = f"{message.kind} telegram" + (f", {fault.field}" if fault.field else "")
            raise TelegramError("field", f"{where}: {fault}", field=fault.field) from None
        return data

    @cached_property
    def _parser(self) -> Any:
        """The compiled schema: same leaves, same checks, without construct's interpreter between them."""
        return self.schema.compile()

    def _explain(self, data: bytes, error: Exception) -> TelegramError:
        """Name the gravest of all faults; the fast path stops at the first."""
        faults: list[Fault] = []
        self.schema.parse(data, faults=faults)
        if not faults:
            faults = [error if isinstance(error, Fault) else Fault("field", str(error))]
        fault = min(faults, key=lambda found: _RANK[found.category])
        where = f"{self.message.__name__.lower()} telegram" + (f", {fault.field}" if fault.field else "")
        return TelegramError(fault.category, f"{where}: {fault}", field=fault.field)

    def _same_names(self, container: Mapping[str, Any]) -> dict[str, Any]:
        return {name: container[name] for name in self._names if name in container}

    def _attributes(self, message: M) -> dict[str, Any]:
        return {name: getattr(message, name) for name in self._names}

    def describe(self) -> list[tuple[str, str, str]]:
        """Return name, size and meaning of each leaf in order, for drawings of the telegram."""
        rows = []
        for leaf in self.schema.subcons:
            inner = getattr(leaf, "subcon", leaf)
            size = str(inner.size) if isinstance(inner, Leaf) and isinstance(inner.size, int) else "n"
            rows.append((leaf.name or "", size, getattr(inner, "meaning", "")))
        return rows
