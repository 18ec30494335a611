"""Verbs that need an answer, and are refused at the broadcast address, where no drive answers."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, Generic, ParamSpec, Protocol, TypeVar, overload

from drivecomm.errors import NotSupported

if TYPE_CHECKING:
    from collections.abc import Callable

    class Addressed(Protocol):
        """Operations at one address.

        answers: whether a drive answers at the address.
        """

        answers: bool


P = ParamSpec("P")
R = TypeVar("R")
Self = TypeVar("Self", bound="Addressed")


class _AnsweredVerb(Generic[Self, P, R]):
    """A verb of operations that is refused at the broadcast address."""

    def __init__(self, verb: Callable[Concatenate[Self, P], R]) -> None:
        name = verb.__name__.removesuffix("_percent").removesuffix("_hz")

        @wraps(verb)
        def refusing(_self: Self, /, *_args: P.args, **_kwargs: P.kwargs) -> R:
            raise NotSupported(f"{name} needs an answer, and no drive answers a broadcast")

        self._verb, self._refusing = verb, refusing

    @overload
    def __get__(self, its: None, owner: type) -> Callable[Concatenate[Self, P], R]: ...
    @overload
    def __get__(self, its: Self, owner: type) -> Callable[P, R]: ...
    def __get__(self, its: Any, owner: type) -> Any:
        """Return the plain verb for a drive that answers, so that a caller that keeps the verb is checked only once."""
        verb: Any = self._verb if its is None or its.answers else self._refusing
        return verb.__get__(its, owner)


def needs_answer(verb: Callable[Concatenate[Self, P], R]) -> _AnsweredVerb[Self, P, R]:
    """Make a verb of operations raise NotSupported at the broadcast address, before it does anything else.

    For methods of a class with the attribute `answers`, which says whether a drive answers at its address:

        @needs_answer
        def read(self, parameter: str) -> Exchange[Reading]: ...
    """
    return _AnsweredVerb(verb)
