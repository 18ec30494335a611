"""What a request may hold, field by field: checked strictly, and described in OpenAPI by the same data."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any, NamedTuple

from starlette.exceptions import HTTPException

from drivecomm.client import parsed
from drivecomm.errors import shortened, unknown_key

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

LONGEST_TEXT = 4096
"""Characters of a text in a request; a telegram or a note is far below it."""


LONGEST_NUMBER = 40
_LOWEST, _HIGHEST = Decimal(-(2**63)), Decimal(2**63)


class Kind(NamedTuple):
    """What a field holds: its types in Python, what an error says to write, and its type in JSON Schema."""

    types: tuple[type, ...]
    words: str
    schema: str


TEXT = Kind((str,), "a text", "string")
WHOLE = Kind((int,), "a whole number", "integer")
NUMBER = Kind((int, float, Decimal), "a number", "number")
CHOICE = Kind((bool,), "true or false", "boolean")
OBJECT = Kind((dict,), "an object", "object")
TEXTS = Kind((list,), "a list of texts", "array")
WHOLES = Kind((list,), "a list of whole numbers", "array")


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One field of a body or a query.

    about: what it is, for the description. needed: without it the request is refused; network: by network doors only.
    local: only callers of the local door may give it. low, high: of a number. choices: of a text.
    """

    kind: Kind
    about: str
    needed: bool = False
    network: bool = False
    local: bool = False
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()

    def checked(self, name: str, value: object) -> Any:
        """Return the value as it is used. Raises HTTPException."""
        kind = self.kind
        if not isinstance(value, kind.types) or (isinstance(value, bool) and kind is not CHOICE):
            raise refusal(f"{name} cannot be {shortened(value)}; give {self.words}")
        if kind is TEXT and len(value) > LONGEST_TEXT:  # type: ignore[arg-type]
            raise refusal(f"{name} is longer than {LONGEST_TEXT} characters")
        if kind is TEXTS and not all(isinstance(each, str) for each in value):  # type: ignore[attr-defined]
            raise refusal(f"{name} cannot be {shortened(value)}; give {self.words}")
        if kind is WHOLES and not all(type(each) is int for each in value):  # type: ignore[attr-defined]
            raise refusal(f"{name} cannot be {shortened(value)}; give {self.words}")
        if self.choices and value not in self.choices:
            raise refusal(f"{name} cannot be {shortened(value)}; give {self.words}")
        if kind in (WHOLE, NUMBER):
            low, high = (_decimal(limit, each) for limit, each in ((self.low, _LOWEST), (self.high, _HIGHEST)))
            if not low <= value <= high:  # type: ignore[operator]
                raise refusal(f"{name} cannot be {str(value)[:LONGEST_NUMBER]}; give {self.words}")
            return value if kind is WHOLE else float(value)  # type: ignore[arg-type]
        return value

    @property
    def words(self) -> str:
        """What to give, for errors."""
        if self.choices:
            return " or ".join(self.choices)
        limits = {"from": self.low, "to": self.high}
        return " ".join([self.kind.words, *(f"{word} {at:g}" for word, at in limits.items() if at is not None)])

    def of_text(self, name: str, text: str) -> Any:
        """Return the value that a query has as text. Raises HTTPException."""
        if self.kind is TEXTS:
            return [each for each in text.split(",") if each]
        if self.kind is TEXT:
            return self.checked(name, text)
        try:
            value = parsed(text)
        except (ValueError, ArithmeticError, RecursionError):
            value = text
        return self.checked(name, value)


def _decimal(limit: float | None, otherwise: Decimal) -> Decimal:
    """Return a limit as it is written: 0.1, and not the binary fraction beside it."""
    return otherwise if limit is None else Decimal(repr(limit))


def of_body(body: bytes, fields: Mapping[str, Field], *, local: bool) -> dict[str, Any]:
    """Return what a body gives. Raises HTTPException for what is no JSON, and for unknown, missing or wrong fields."""
    try:
        content = parsed(body) if body.strip() else {}
    except (ValueError, ArithmeticError, RecursionError):
        raise refusal("the body is not JSON") from None
    if not isinstance(content, dict):
        raise refusal("the body is not a JSON object; give it in braces")
    _check_names(content, fields, "the request has an unknown field", local=local)
    return {name: fields[name].checked(name, value) for name, value in content.items() if value is not None}


def of_query(pairs: Iterable[tuple[str, str]], fields: Mapping[str, Field], *, local: bool) -> dict[str, Any]:
    """Return what a query gives. Raises HTTPException, as above."""
    given: dict[str, str] = {}
    for name, text in pairs:
        if name in given:
            raise refusal(f"the query gives {shortened(name)} twice")
        given[name] = text
    _check_names(given, fields, "the query has an unknown field", local=local)
    return {name: fields[name].of_text(name, text) for name, text in given.items()}


def _check_names(given: Mapping[str, Any], fields: Mapping[str, Field], what: str, *, local: bool) -> None:
    for name in given:
        if name not in fields:
            raise refusal(f"{what}: {unknown_key(name[:LONGEST_TEXT], fields)}".replace("unknown field: ", ""))
        if fields[name].local and not local:
            raise HTTPException(403, f"{name} is for callers of the local door only")
    for name, field in fields.items():
        if (field.needed or (field.network and not local)) and given.get(name) is None:
            raise refusal(f"the field {name!r} is missing; give {field.words}: {field.about}")


def refusal(text: str) -> HTTPException:
    """Return the error for a request that cannot be understood."""
    return HTTPException(422, text)
