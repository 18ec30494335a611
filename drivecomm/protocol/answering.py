"""Verbs that need an answer, and are refused where nobody gives one: at the address of all drives."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Concatenate, ParamSpec, Protocol, TypeVar

from drivecomm.errors import NotSupported

if TYPE_CHECKING:
    from collections.abc import Callable

    class Addressed(Protocol):
        """Whoever has verbs. answers: whether a drive answers at its address."""

        answers: bool


P = ParamSpec("P")
R = TypeVar("R")
Self = TypeVar("Self", bound="Addressed")


def needs_answer(verb: Callable[Concatenate[Self, P], R]) -> Callable[Concatenate[Self, P], R]:
    """Make a verb raise NotSupported where nobody answers, before it does anything else."""
    name = verb.__name__.removesuffix("_percent").removesuffix("_hz")

    @wraps(verb)
    def checked(self: Self, /, *args: P.args, **kwargs: P.kwargs) -> R:
        if not self.answers:
            raise NotSupported(f"{name} needs an answer, and nobody answers a broadcast")
        return verb(self, *args, **kwargs)

    return checked
