"""Registered cases, and the catalogue of cases for a drive and a master.

    @case("lost", "read", title="no reply to a read arrives")
    def lost(trial: Trial) -> str:
        \"\"\"The master shows an error or nothing.\"\"\"

A case is named after its task and its own name: read-lost. Its docstring states the condition for passing. Its function
returns the reason for passing, and raises CaseFailure or NotTried.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from inspect import getdoc
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError, suggestion

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from drivecomm.judge.known_drive import KnownDrive
    from drivecomm.judge.order import JudgeOrder
    from drivecomm.judge.trial import CaseContext


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgeCase:
    """One disturbance that a master must survive.

    name: the names of task and case, such as read-lost. task: the task of the master. title: the disturbance. passes:
    the condition for passing. play: runs the case.
    """

    name: str
    task: str
    title: str
    passes: str
    play: Callable[[CaseContext], str]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Registered:
    name: str
    tasks: tuple[str, ...]
    title: str
    function: Callable[..., str]
    each: Callable[[KnownDrive, JudgeOrder, str], Iterable[tuple[str, str, Any]]] | None


_registered: list[_Registered] = []


def case(
    name: str,
    *tasks: str,
    title: str,
    each: Callable[[KnownDrive, JudgeOrder, str], Iterable[tuple[str, str, Any]]] | None = None,
) -> Callable[[Callable[..., str]], Callable[..., str]]:
    """Register a case for these tasks.

    each: yields variants for a drive and a task: a suffix of the name, a suffix of the title, and the function's second
    argument. One case is made for each variant.
    """

    def register(function: Callable[..., str]) -> Callable[..., str]:
        _registered.append(_Registered(name=name, tasks=tasks, title=title, function=function, each=each))
        return function

    return register


def catalogue(known: KnownDrive, order: JudgeOrder) -> list[JudgeCase]:
    """Return the cases for the tasks of a master, basic cases first."""
    import drivecomm.judge.cases  # noqa: F401 - registers the cases

    return [
        made
        for task in order.tasks
        for each in _registered
        if task.name in each.tasks
        for made in _made(each, known, order, task.name)
    ]


def _made(registered: _Registered, known: KnownDrive, order: JudgeOrder, task: str) -> list[JudgeCase]:
    passes = (getdoc(registered.function) or "").partition("\n")[0]
    variants = registered.each(known, order, task) if registered.each else [("", "", None)]
    return [
        JudgeCase(
            name=f"{task}-{registered.name}{end}",
            task=task,
            title=registered.title + more,
            passes=passes,
            play=registered.function if registered.each is None else partial(_with, registered.function, given),
        )
        for end, more, given in variants
    ]


def _with(function: Callable[..., str], given: Any, trial: CaseContext) -> str:
    return function(trial, given)


def cases_named(cases: Sequence[JudgeCase], names: Sequence[str]) -> list[JudgeCase]:
    """Return the cases with these names, or all if no names are given. Raises UsageError for an unknown name."""
    known = [each.name for each in cases]
    for name in names:
        if name not in known:
            raise UsageError(f"no case {name!r}; {suggestion(name, known, 'the cases are')}")
    return [each for each in cases if not names or each.name in names]
