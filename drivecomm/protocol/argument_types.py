"""Whether what a caller gives is of the type that a signature or a dataclass asks for.

Annotations are the one place that says it. What they name and is not known here is not judged.
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
"""Stands for all names that a function takes without naming them."""


def misfit(owner: Callable[..., Any], given: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the first argument whose value is not of the type that its owner asks for, and what to give instead.

    owner: a function or a dataclass.
    """
    hints = _hints(getattr(owner, "__func__", owner))
    for name, value in given.items():
        hint = hints.get(name, hints.get(_FURTHER, Any))
        if not _fits(value, hint):
            return name, words_for(hint)
    return None


def as_asked(owner: Callable[..., Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is given; a whole number becomes a text where only a text is asked for, such as an address."""
    hints = _hints(owner)
    texts = {name: str(value) for name, value in given.items() if hints.get(name) is str and type(value) is int}
    return {**given, **texts}


def choices_of(owner: Callable[..., Any]) -> Mapping[str, tuple[Any, ...]]:
    """Return the arguments that are a choice of a few values, with these.

    owner: a function or a dataclass.
    """
    return {name: values for name, hint in _hints(owner).items() if (values := _few(hint))}


def _few(hint: Any) -> tuple[Any, ...]:
    """Return the values of a type that has only a few; nothing for any other."""
    if get_origin(hint) in (Union, UnionType):
        each = [_few(part) for part in get_args(hint)]
        return sum(each, ()) if all(each) else ()
    return (False, True) if hint is bool else get_args(hint) if get_origin(hint) is Literal else ()


def words_for(hint: Any) -> str:
    """Return what a type takes, in words."""
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
    """Whether a value is a whole number, and of a size that something real can have."""
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < _TOO_LARGE


def is_number(value: object) -> TypeGuard[int | float | Decimal]:
    """Whether a value is a number that a float can hold, and no text for one."""
    if isinstance(value, float):
        return isfinite(value)
    return is_whole(value) or (isinstance(value, Decimal) and value.is_finite() and abs(value) < _TOO_LARGE)


def is_duration(value: object) -> TypeGuard[int | float]:
    """Whether a value is a time in seconds, 0 or more and of a length that something real can have."""
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
            # Named for type checkers only; what cannot be told is not judged.
            continue
    code = getattr(owner, "__code__", None)
    if code is not None and code.co_flags & inspect.CO_VARKEYWORDS:
        several = bool(code.co_flags & inspect.CO_VARARGS)
        found[_FURTHER] = found.get(code.co_varnames[code.co_argcount + code.co_kwonlyargcount + several], Any)
    return found
