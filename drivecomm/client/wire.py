"""JSON messages between a server and its clients: exact decimals are numbers with all their digits.

Readings, statuses and errors have one form each, which both sides use. It is the public form of the server's API.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from decimal import Decimal
from enum import Enum
from functools import cache
from json.encoder import encode_basestring_ascii as _quoted
from math import isfinite
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm import errors
from drivecomm.errors import DriveCommError, RefusedError, TelegramError, TooOftenError, WrongDriveError, in_one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.protocol import DriveStatus, ParameterInfo, Reading

Json: TypeAlias = "dict[str, Any] | list[Any] | str | int | float | Decimal | bool | None"


def json_text(content: Any) -> str:
    """Return JSON for the output of `plain`, with decimals as numbers that keep their digits: 10.00 stays 10.00.

    A decimal without a point is written with an exponent, 50E0, so that it is read as a decimal again.
    """
    # Speed matters: the stream encodes each changed value here.
    write = _WRITTEN.get(type(content))
    if write is not None:
        return write(content)
    if isinstance(content, str):
        return _quoted(content)
    if isinstance(content, Decimal):
        return _decimal(content)
    if isinstance(content, dict):
        return _object(content)
    if isinstance(content, list | tuple):
        return _array(content)
    return json.dumps(content, allow_nan=False)


def _number(content: float) -> str:
    return repr(content) if isfinite(content) else json.dumps(content, allow_nan=False)


def _decimal(content: Decimal) -> str:
    text = str(content)
    if not content.is_finite():
        # NaN and infinity have no number form in JSON, so they are written as text.
        return f'"{text}"'
    return text if "." in text or "E" in text else f"{text}E0"


def _object(content: dict[Any, Any]) -> str:
    return "{" + ",".join([f"{_quoted(str(key))}:{json_text(each)}" for key, each in content.items()]) + "}"


def _array(content: Sequence[Any]) -> str:
    return "[" + ",".join([json_text(each) for each in content]) + "]"


_WRITTEN: Mapping[type, Callable[[Any], str]] = {
    str: _quoted,
    type(None): lambda _: "null",
    float: _number,
    int: repr,
    Decimal: _decimal,
    dict: _object,
    list: _array,
    tuple: _array,
}
"""Writers of the most common types."""


def parsed(text: str | bytes) -> Any:
    """Return the content of JSON; numbers with a point or an exponent are exact decimals. Raises ValueError."""
    return json.loads(text, parse_float=Decimal, parse_constant=_refuse)


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


def plain(value: Any) -> Any:
    """Convert a value to JSON types and exact decimals: dataclasses by their fields, bytes as hexadecimal."""
    if value is None or (isinstance(value, str | int | float | Decimal) and not isinstance(value, Enum)):
        return value
    if type(value).__name__ == "Reading":
        return {**{name: getattr(value, name) for name in _names(value)}, "quality": value.quality}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {name: plain(getattr(value, name)) for name in _names(value)}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, bytes):
        return value.hex(" ").upper()
    if isinstance(value, DriveCommError):
        return error_content(value)
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, set | frozenset):
        return sorted(map(plain, value))
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return str(value)


def _names(value: Any) -> tuple[str, ...]:
    return _names_of(value.__class__)


@cache
def _names_of(owner: Any) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(owner))


def reading_of(content: Mapping[str, Any]) -> Reading:
    """Rebuild a reading from its plain form."""
    from drivecomm.protocol import Reading

    fields = {key: each for key, each in content.items() if key != "quality"}
    return Reading(**{**fields, "time_s": float(fields.get("time_s", 0.0))})


def status_of(content: Mapping[str, Any]) -> DriveStatus:
    """Rebuild a status from its plain form."""
    from drivecomm.protocol import DriveState, DriveStatus

    exact = {
        key: None if content.get(key) is None else Decimal(content[key]) for key in ("actual_percent", "actual_hz")
    }
    state, flags = DriveState(content["state"]), tuple(content.get("flags", ()))
    return DriveStatus(**{**content, **exact, "state": state, "flags": flags})


def parameter_of(content: Mapping[str, Any]) -> ParameterInfo:
    """Rebuild a parameter description from its plain form."""
    from drivecomm.protocol import ParameterInfo

    exact = {
        name: None if content.get(name) is None else Decimal(content[name]) for name in ("factor", "minimum", "maximum")
    }
    values = {int(number): text for number, text in content.get("values", {}).items()}
    only_with = {address: tuple(some) for address, some in content.get("only_with", {}).items()}
    return ParameterInfo(**{**content, **exact, "values": values, "only_with": only_with})


def drive_options(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a drive for `Bus.drive`, which takes times as floats; in JSON they are exact decimals."""
    return {name: float(value) if isinstance(value, Decimal) else value for name, value in content.items()}


def result_of(content: Any) -> Any:
    """Rebuild the result of a verb from its plain form.

    The result is a reading, a status, a parameter description, or a list of them, in which an error may stand in place
    of a reading. Any other value is returned unchanged.
    """
    if isinstance(content, list):
        return [result_of(each) for each in content]
    if isinstance(content, dict):
        if "kind" in content and "exit_code" in content:
            return error_of(content)
        if "raw" in content and "parameter" in content:
            return reading_of(content)
        if "word" in content and "state" in content:
            return status_of(content)
        if "factor" in content and "address" in content:
            return parameter_of(content)
    return content


def error_content(error: DriveCommError) -> dict[str, Any]:
    """Return an error in plain form: its kind, its sentence, its exit code, and its facts about the drive."""
    content: dict[str, Any] = {
        "kind": type(error).__name__,
        "text": in_one_line(error),
        "exit_code": error.exit_code,
    }
    if error.says:
        content["says"] = list(error.says)
    if error.about:
        content["about"] = dict(error.about)
    if isinstance(error, RefusedError):
        content |= {"parameter": error.parameter, "code": error.code, "reason": error.reason}
    if isinstance(error, TooOftenError):
        content["wait_s"] = error.wait_s
    if isinstance(error, WrongDriveError):
        content |= {"model": error.model, "found": error.found, "candidates": list(error.candidates)}
    if isinstance(error, TelegramError):
        content |= {"category": error.category, "field": error.field}
    return content


def error_of(content: Mapping[str, Any]) -> DriveCommError:
    """Rebuild an error from its plain form; an unknown kind becomes an error of the same branch."""
    kind = _kinds().get(str(content.get("kind", "")))
    text = str(content.get("text", "the server gives no reason"))
    made: DriveCommError
    if kind is RefusedError:
        made = RefusedError(str(content.get("parameter", "")), content.get("code"), str(content.get("reason", "")))
        made.args = (text,)
    elif kind is TelegramError:
        made = TelegramError(content.get("category", "field"), text, field=str(content.get("field", "")))
    elif kind is WrongDriveError:
        found = {key: str(content.get(key, "")) for key in ("model", "found")}
        made = WrongDriveError(text, candidates=tuple(content.get("candidates", ())), **found)
    elif kind is TooOftenError:
        made = TooOftenError(text, wait_s=float(content.get("wait_s", 1.0)))
    else:
        made = (kind or _by_exit_code().get(content.get("exit_code", 1), DriveCommError))(text)
    made.says = tuple(content.get("says", ()))
    if about := content.get("about"):
        made.about = dict(about)
    return made


@cache
def _kinds() -> dict[str, type[DriveCommError]]:
    return {
        name: each for name, each in vars(errors).items() if isinstance(each, type) and issubclass(each, DriveCommError)
    }


@cache
def _by_exit_code() -> dict[int, type[DriveCommError]]:
    branches = (errors.UsageError, errors.LinkError, errors.ReplyError, errors.DriveError)
    return {each.exit_code: each for each in branches}
