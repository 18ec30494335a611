"""Checks that a caller's arguments have the types that a signature or a dataclass declares.

Only the annotations declare types. A type that cannot be resolved here is not checked.
"""

from __future__ import annotations

import inspect
import sys
from decimal import Decimal
from functools import lru_cache
from math import isfinite
from types import NoneType, SimpleNamespace, UnionType
from typing import TYPE_CHECKING, Any, Literal, TypeGuard, Union, get_args, get_origin, get_type_hints

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_WORDS: Mapping[object, str] = {
    str: "a text",
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    Decimal: "a number",
    NoneType: "None",
}

_TOO_LARGE = 2**64
_LONGEST_S = 1e9

_FURTHER = "**"
"""Key for the type of all keyword arguments that a function collects with `**`."""


def misfit(owner: Callable[..., Any], given: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the name of the first argument of the wrong type and a text for the right type; None if all types fit.

    owner: a function or a dataclass.
    """
    hints = _hints(getattr(owner, "__func__", owner))
    for name, value in given.items():
        hint = hints.get(name, hints.get(_FURTHER, Any))
        if not _fits(value, hint):
            return name, words_for(hint)
    return None


def as_asked(owner: Callable[..., Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments, with a whole number as text if only text is declared, as for an address."""
    hints = _hints(owner)
    texts = {name: str(value) for name, value in given.items() if hints.get(name) is str and type(value) is int}
    return {**given, **texts}


def choices_of(owner: Callable[..., Any]) -> Mapping[str, tuple[Any, ...]]:
    """Return the allowed values of each argument that is a choice of a few values.

    owner: a function or a dataclass.
    """
    return {name: values for name, hint in _hints(owner).items() if (values := _few(hint))}


def _few(hint: Any) -> tuple[Any, ...]:
    """Return the values of a type that has only a few, such as bool or Literal; empty for any other type."""
    if get_origin(hint) in (Union, UnionType):
        each = [_few(part) for part in get_args(hint)]
        return sum(each, ()) if all(each) else ()
    return (False, True) if hint is bool else get_args(hint) if get_origin(hint) is Literal else ()


def words_for(hint: Any) -> str:
    """Return a description of a type for error messages."""
    if get_origin(hint) is Literal:
        return " or ".join(str(each) or '""' for each in get_args(hint))
    if get_origin(hint) in (Union, UnionType):
        return " or ".join(dict.fromkeys(words_for(each) for each in get_args(hint)))
    if get_origin(hint) is tuple:
        return "a list"
    return _WORDS.get(hint, getattr(hint, "__name__", str(hint)))


def _fits(value: object, hint: Any) -> bool:
    origin = get_origin(hint)
    if hint is Any or hint is object:
        return True
    if origin in (Union, UnionType):
        return any(_fits(value, each) for each in get_args(hint))
    if origin is Literal:
        return isinstance(value, str | int | None) and value in get_args(hint)
    if origin is tuple:
        if not isinstance(value, tuple | list | frozenset | set):
            return False
        return all(_fits(each, get_args(hint)[0]) for each in value)
    if hint in (float, Decimal):
        return is_number(value)
    if hint is int:
        return is_whole(value)
    return isinstance(value, hint) if isinstance(hint, type) else True


def is_whole(value: object) -> TypeGuard[int]:
    """Return whether a value is a whole number of a plausible size, below 2**64; bool does not count."""
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < _TOO_LARGE


def is_number(value: object) -> TypeGuard[int | float | Decimal]:
    """Return whether a value is a finite number of a plausible size; text and bool do not count."""
    if isinstance(value, float):
        return isfinite(value)
    return is_whole(value) or (isinstance(value, Decimal) and value.is_finite() and abs(value) < _TOO_LARGE)


def is_duration(value: object) -> TypeGuard[int | float]:
    """Return whether a value is a plausible time in seconds, from 0 to 1e9."""
    return isinstance(value, int | float) and is_number(value) and 0 <= value <= _LONGEST_S


@lru_cache(maxsize=256)
def _hints(owner: Callable[..., Any]) -> Mapping[str, Any]:
    module = sys.modules.get(getattr(owner, "__module__", ""))
    known = {"Decimal": Decimal, "Value": int | Decimal | str, "ParameterValue": int | Decimal | str}
    found = {}
    for name, annotation in getattr(owner, "__annotations__", {}).items():
        alone = SimpleNamespace(__annotations__={name: annotation})
        try:
            found.update(get_type_hints(alone, vars(module) if module else {}, known))
        except (NameError, TypeError, AttributeError):
            # The name exists for type checkers only; a type that cannot be resolved is not checked.
            continue
    code = getattr(owner, "__code__", None)
    if code is not None and code.co_flags & inspect.CO_VARKEYWORDS:
        several = bool(code.co_flags & inspect.CO_VARARGS)
        found[_FURTHER] = found.get(code.co_varnames[code.co_argcount + code.co_kwonlyargcount + several], Any)
    return found
