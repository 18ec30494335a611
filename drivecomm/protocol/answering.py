"""Verbs that need an answer, and are refused where nobody gives one: at the address of all drives."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, Generic, ParamSpec, Protocol, TypeVar, overload

from drivecomm.errors import NotSupported

if TYPE_CHECKING:
    from collections.abc import Callable

    class Addressed(Protocol):
        """Whoever has verbs. answers: whether a drive answers at its address."""

        answers: bool


P = ParamSpec("P")
R = TypeVar("R")
Self = TypeVar("Self", bound="Addressed")


class _AnsweredVerb(Generic[Self, P, R]):
    """A verb of operations that is refused at the address of all drives."""

    def __init__(self, verb: Callable[Concatenate[Self, P], R]) -> None:
        name = verb.__name__.removesuffix("_percent").removesuffix("_hz")

        @wraps(verb)
        def refusing(_self: Self, /, *_args: P.args, **_kwargs: P.kwargs) -> R:
            raise NotSupported(f"{name} needs an answer, and nobody answers a broadcast")

        self._verb, self._refusing = verb, refusing

    @overload
    def __get__(self, its: None, owner: type) -> Callable[Concatenate[Self, P], R]: ...
    @overload
    def __get__(self, its: Self, owner: type) -> Callable[P, R]: ...
    def __get__(self, its: Any, owner: type) -> Any:
        """Return the verb itself for a drive that answers: who calls it again and again looks at that once."""
        verb: Any = self._verb if its is None or its.answers else self._refusing
        return verb.__get__(its, owner)


def needs_answer(verb: Callable[Concatenate[Self, P], R]) -> _AnsweredVerb[Self, P, R]:
    """Make a verb of operations raise NotSupported at the address of all drives, before it does anything else.

    For methods of a class with the attribute `answers`, which says whether a drive answers at its address:

        @needs_answer
        def read(self, parameter: str) -> Exchange[Reading]: ...
    """
    return _AnsweredVerb(verb)
