"""What came of a call, as data, and whether it is what was expected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from decimal import Decimal
from enum import Enum
from typing import TYPE_CHECKING, Any

from drivecomm import errors
from drivecomm.testing.case import expect
from drivecomm.testing.report import CheckFailure

if TYPE_CHECKING:
    from drivecomm.errors import DriveCommError
    from drivecomm.testing.exchange_vectors import Call


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a call, or the error that it raised."""

    result: Any = None
    error: DriveCommError | None = None


def judge(call: Call, outcome: Outcome) -> None:
    """Compare what came of a call with what was expected. Raises CheckFailure."""
    expected, error = call.expected, outcome.error
    if expected.error:
        kind: type[DriveCommError] = getattr(errors, expected.error)
        if error is None:
            raise CheckFailure(f"{call.call} gives {as_data(outcome.result)!r}, expected is {expected.error}")
        expect(
            isinstance(error, kind) and expected.error_text in str(error),
            f"{call.call} raises {type(error).__name__} ({error}), expected is {expected.error}"
            + (f" with {expected.error_text!r}" if expected.error_text else ""),
        )
        return
    if error is not None:
        raise CheckFailure(f"{call.call} raises {type(error).__name__}: {error}") from error
    if expected.result is not None:
        _judge_result(call.call, outcome.result, expected.result)


def as_data(value: object) -> Any:
    """Return a value as vectors write it: exact decimals as text, enums by their values."""
    if isinstance(value, Decimal):
        return f"{value:f}"
    if isinstance(value, Enum):
        return as_data(value.value)
    if isinstance(value, Mapping):
        return {str(as_data(key)): as_data(each) for key, each in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: as_data(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, set | frozenset):
        return sorted(map(as_data, value))
    if isinstance(value, list | tuple):
        return [as_data(each) for each in value]
    return value


def _judge_result(name: str, result: object, wanted: Mapping[str, Any]) -> None:
    found = as_data(result)
    if not wanted:
        expect(found is None or found == {}, f"{name} gives {found!r}, expected is nothing")
        return
    if not isinstance(found, dict):
        found = {"value": found}
    for key, value in wanted.items():
        expect(key in found, f"{name} gives nothing named {key}; it gives {found}")
        expect(same(found[key], value), f"{name} gives {key} = {found[key]!r}, expected is {value!r}")


def same(found: object, wanted: object) -> bool:
    """Whether two pieces of data are equal and of one type: a flag is no number."""
    if isinstance(found, list) and isinstance(wanted, list):
        return len(found) == len(wanted) and all(map(same, found, wanted))
    if isinstance(found, dict) and isinstance(wanted, dict):
        return found.keys() == wanted.keys() and all(same(found[key], wanted[key]) for key in wanted)
    return type(found) is type(wanted) and found == wanted
