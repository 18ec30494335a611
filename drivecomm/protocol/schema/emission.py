"""Python code of leaves: the part of each leaf in the function that reads or writes a whole telegram."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

REFUSE = "raise ValueError"
"""Statement for invalid input; the declared schema then finds the fault."""


class Code:
    """Lines of one function, and the objects to which they refer by name."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[str, object] = {}
        self._refusal = REFUSE

    def line(self, text: str) -> None:
        """Add a line."""
        self.lines.append(text)

    def refer(self, value: object) -> str:
        """Return a new name for this object in the code."""
        name = f"c{len(self.names)}"
        self.names[name] = value
        return name

    def let(self, expression: str) -> str:
        """Add an assignment of an expression to a fresh variable; return the variable."""
        name = f"v{len(self.lines)}"
        self.line(f"{name} = {expression}")
        return name

    def refuse_if(self, condition: str) -> None:
        """Add a line that leaves the function if this condition holds."""
        self.line(f"if {condition}: {self._refusal}")

    @contextmanager
    def refusing(self, refusal: str) -> Iterator[None]:
        """Leave the function by this statement instead of `REFUSE` in all lines that are added within the context."""
        self._refusal = refusal
        yield
        self._refusal = REFUSE

    @contextmanager
    def trying(self, refusal: str) -> Iterator[None]:
        """Leave the function by this statement if a line that is added within the context raises an exception."""
        begun = len(self.lines)
        yield
        tried = self.lines[begun:]
        if tried:
            self.lines[begun:] = ["try:", *(f"    {line}" for line in tried), f"except Exception: {refusal}"]

    def function(self, name: str, argument: str) -> Callable[[Any], Any]:
        """Compile the lines to a function and return it."""
        source = f"def {name}({argument}):\n" + "".join(f"    {line}\n" for line in self.lines)
        namespace = dict(self.names)
        # Safe to execute: all lines come from leaves, and names and values of others are referred to, never pasted.
        exec(compile(source, f"<{name}>", "exec"), namespace)  # noqa: S102
        return cast("Callable[[Any], Any]", namespace[name])


@dataclass(frozen=True, slots=True, kw_only=True)
class Emission:
    """Code of a leaf with a fixed or given size.

    cut: the `struct` format of its characters: B, H, I, b, h, i for numbers, otherwise an s for each character. read:
    adds lines that refuse invalid content and returns an expression for the value, given an expression for the
    characters. write: adds lines that refuse an invalid value and returns an expression for the characters, which must
    fill the cut exactly. Both refuse at least all that the leaf itself refuses: a refused telegram is read or written
    once more by the declared leaves.
    """

    cut: str
    read: Callable[[Code, str], str]
    write: Callable[[Code, str], str]


def called(size: object, read: Callable[[bytes], Any], write: Callable[[Any], bytes]) -> Emission:
    """Return an emission that calls the leaf's own functions.

    A leaf of one character is called for all characters in advance and looked up later. Without a fixed size, the form
    checks the length.
    """

    def emit_read(code: Code, cut: str) -> str:
        return code.let(f"{code.refer(read)}({cut})")

    def emit_lookup(code: Code, cut: str) -> str:
        return code.let(f"{code.refer(_meanings(read))}[{cut}]")

    def emit_write(code: Code, value: str) -> str:
        data = code.let(f"{code.refer(write)}({value})")
        if isinstance(size, int):
            code.refuse_if(f"len({data}) != {size}")
        return f"{data}[0]" if size == 1 else data

    return Emission(
        cut=_cut(size) if isinstance(size, int) else "", read=emit_lookup if size == 1 else emit_read, write=emit_write
    )


def _meanings(read: Callable[[bytes], Any]) -> dict[int, Any]:
    meanings = {}
    for byte in range(256):
        try:
            meanings[byte] = read(bytes([byte]))
        except Exception:  # noqa: BLE001, S112 - the leaf itself refuses it as well
            continue
    return meanings


def looked_up(table: Mapping[bytes, Any]) -> Emission:
    """Return an emission that looks up the characters and values of a `choice`; equal values count as the same."""
    size = len(next(iter(table)))
    read = {_key(data): value for data, value in table.items()}
    written = {value: data for data, value in read.items()}
    return Emission(
        cut=_cut(size),
        read=lambda code, cut: code.let(f"{code.refer(read)}[{cut}]"),
        write=lambda code, value: code.let(f"{code.refer(written)}[{value}]"),
    )


def enumerated(size: int, values: Iterable[Any], kind: type[Any], write: Callable[[Any], bytes]) -> Emission:
    """Return an emission that looks up all values of a leaf in a table; the table is made on the first use.

    kind: the type of all values.
    """
    tables: list[dict[Any, Any]] = []

    def made() -> list[dict[Any, Any]]:
        if not tables:
            data = {value: _key(write(value)) for value in values}
            tables.extend([{characters: value for value, characters in data.items()}, data])
        return tables

    def emit_read(code: Code, cut: str) -> str:
        return code.let(f"{code.refer(made()[0])}[{cut}]")

    def emit_write(code: Code, value: str) -> str:
        # The table finds True and 1.0 under 1, although they are not valid in a telegram.
        code.refuse_if(f"type({value}) is not {kind.__name__}")
        return code.let(f"{code.refer(made()[1])}[{value}]")

    return Emission(cut=_cut(size), read=emit_read, write=emit_write)


def fixed(written: bytes, *, must_be: bool) -> Emission:
    """Return an emission for characters that are always the same.

    must_be: whether reading refuses other characters; otherwise reading ignores the characters.
    """
    key = _key(written)

    def emit_read(code: Code, cut: str) -> str:
        if must_be:
            code.refuse_if(f"{cut} != {key!r}")
        return "None"

    return Emission(cut=_cut(len(written)), read=emit_read, write=lambda code, value: repr(key))  # noqa: ARG005


def as_they_are(size: int) -> Emission:
    """Return an emission for characters that the form itself computes."""
    return Emission(cut=f"{size}s", read=lambda code, cut: cut, write=lambda code, value: value)  # noqa: ARG005


def number(letter: str, allowed: object | None) -> Emission:
    """Return an emission for a binary number.

    letter: the `struct` format of the number. allowed: the permitted numbers, None for all of them.
    """

    def emit_read(code: Code, cut: str) -> str:
        if allowed is not None:
            code.refuse_if(f"{cut} not in {code.refer(allowed)}")
        return cut

    def emit_write(code: Code, value: str) -> str:
        code.refuse_if(f"type({value}) is not int")
        return emit_read(code, value)

    return Emission(cut=letter, read=emit_read, write=emit_write)


def digits(size: int, wrong: str, convert: str, layout: bytes, allowed: object) -> Emission:
    """Return an emission for a number in digits.

    wrong: condition for characters that are not digits. convert: expression for the number in the characters. layout:
    format for writing the number.
    """

    def emit_read(code: Code, cut: str) -> str:
        code.refuse_if(wrong.format(cut))
        value = code.let(convert.format(cut))
        code.refuse_if(f"{value} not in {code.refer(allowed)}")
        return value

    def emit_write(code: Code, value: str) -> str:
        code.refuse_if(f"type({value}) is not int or {value} not in {code.refer(allowed)}")
        return code.let(f"{layout!r} % {value}")

    return Emission(cut=_cut(size), read=emit_read, write=emit_write)


def text(size: object, permitted: bytes) -> Emission:
    """Return an emission for characters of ISO 8859-1 among those permitted.

    Without a fixed size, the form checks the length.
    """
    all_permitted = len(permitted) == 256

    def emit_read(code: Code, cut: str) -> str:
        if not all_permitted:
            code.refuse_if(f"{cut}.translate(None, {code.refer(permitted)})")
        return code.let(f'{cut}.decode("latin-1")')

    def emit_write(code: Code, value: str) -> str:
        code.refuse_if(f"type({value}) is not str")
        data = code.let(f'{value}.encode("latin-1")')
        if not all_permitted:
            code.refuse_if(f"{data}.translate(None, {code.refer(permitted)})")
        if isinstance(size, int):
            code.refuse_if(f"len({data}) != {size}")
        return data

    # A single character is cut as bytes, too, because a number does not have the methods used above.
    return Emission(cut=f"{size}s" if isinstance(size, int) else "", read=emit_read, write=emit_write)


def _cut(size: int) -> str:
    return "B" if size == 1 else f"{size}s"


def _key(data: bytes) -> int | bytes:
    """Return characters as `struct` cuts them: a single one is a number."""
    return data[0] if len(data) == 1 else data
