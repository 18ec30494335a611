"""Verbs that are declared once, as jobs for the bus: `Drive` waits for the job, `AsyncDrive` awaits it.

A drive whose bus is in another process sends the call instead: the verb, and its arguments by name.
"""

from __future__ import annotations

from functools import wraps
from inspect import BoundArguments, Signature, signature
from typing import TYPE_CHECKING, Any, Concatenate, Generic, ParamSpec, TypeVar, overload

from drivecomm.errors import UsageError, shortened

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterator
    from decimal import Decimal

    from drivecomm.bus.feeding import Feeding
    from drivecomm.line import Job
    from drivecomm.protocol import LinkLoss, Stop

P = ParamSpec("P")
T = TypeVar("T")


class Verb(Generic[P, T]):
    """A method that returns a job. `BlockingCalls` and `AwaitedCalls` run the job and return its result."""

    def __init__(self, job_of: Callable[Concatenate[Any, P], Job[T]]) -> None:
        self.job_of = job_of
        self.__doc__ = job_of.__doc__

    @overload
    def __get__(self, drive: None, owner: type) -> Callable[..., Any]: ...
    @overload
    def __get__(self, drive: BlockingCalls, owner: type) -> Callable[P, T]: ...
    @overload
    def __get__(self, drive: AwaitedCalls, owner: type) -> Callable[P, Coroutine[Any, Any, T]]: ...
    def __get__(self, drive: object, owner: type) -> Any:
        """Return the method that declares the job; subclasses for callers override it by a method of the same name."""
        return self.job_of.__get__(drive, owner)


class BlockingCalls:
    """Base of classes whose verbs return when their job is done."""

    def __init_subclass__(cls) -> None:
        for name, job_of in _declared(cls):
            setattr(cls, name, _blocking(job_of))


class AwaitedCalls:
    """Base of classes whose verbs are awaited."""

    def __init_subclass__(cls) -> None:
        for name, job_of in _declared(cls):
            setattr(cls, name, _awaited(job_of))


class RemoteCalls:
    """Base of classes whose verbs are carried out by another process: `send` returns the result."""

    def feeding(self, policy: LinkLoss, watchdog_s: Decimal, on_leaving: Stop | None) -> Feeding:
        """Return the procedures that keep the motor of this drive; implemented by each subclass."""
        raise NotImplementedError

    def __init_subclass__(cls) -> None:
        for name, job_of in _declared(cls):
            setattr(cls, name, _sent(name, job_of))

    def send(self, verb: str, arguments: dict[str, Any], job: Callable[[], Job[Any]]) -> Any:
        """Send a verb to the other process; implemented by each subclass.

        job: makes the job that a bus in this process would carry out, and raises the errors of an impossible call.
        """
        raise NotImplementedError


def _declared(face: type) -> Iterator[tuple[str, Callable[..., Job[Any]]]]:
    for base in face.__mro__:
        yield from ((name, each.job_of) for name, each in vars(base).items() if isinstance(each, Verb))


def _blocking(job_of: Callable[..., Job[T]]) -> Callable[..., T]:
    @wraps(job_of)
    def verb(self: Any, *values: Any, **options: Any) -> T:
        try:
            job = job_of(self, *values, **options)
        except TypeError:
            _bound(job_of, signature(job_of), self, values, options)
            raise
        result: T = self._bus.run(job)
        return result

    return _returning_result(verb)


def _awaited(job_of: Callable[..., Job[T]]) -> Callable[..., Coroutine[Any, Any, T]]:
    @wraps(job_of)
    async def verb(self: Any, *values: Any, **options: Any) -> T:
        try:
            job = job_of(self, *values, **options)
        except TypeError:
            _bound(job_of, signature(job_of), self, values, options)
            raise
        result: T = await self._bus.run(job)
        return result

    return _returning_result(verb)


def _sent(name: str, job_of: Callable[..., Job[T]]) -> Callable[..., T]:
    declared = signature(job_of)
    further = next((each.name for each in declared.parameters.values() if each.kind is each.VAR_KEYWORD), "")
    first, *_ = declared.parameters

    @wraps(job_of)
    def verb(self: Any, *values: Any, **options: Any) -> T:
        arguments = dict(_bound(job_of, declared, self, values, options).arguments)
        del arguments[first]
        arguments |= arguments.pop(further, {})
        result: T = self.send(name, arguments, lambda: job_of(self, *values, **options))
        return result

    return _returning_result(verb)


def _bound(
    job_of: Callable[..., Job[Any]],
    declared: Signature,
    drive: object,
    values: tuple[Any, ...],
    options: dict[str, Any],
) -> BoundArguments:
    """Return the arguments of a verb by name. Raises UsageError that shows the right call if they do not fit."""
    try:
        return declared.bind(drive, *values, **options)
    except TypeError as error:
        name = job_of.__name__
        _, *own = (each.replace(annotation=each.empty) for each in declared.parameters.values())
        places = [each for each in own if each.kind in {each.POSITIONAL_ONLY, each.POSITIONAL_OR_KEYWORD}]
        named = [each.name for each in own if each.kind is each.KEYWORD_ONLY]
        if named and len(values) > len(places):
            value = shortened(values[len(places)])
            ways = " or ".join(f"{each}={value}" for each in named)
            raise UsageError(f"{name} does not take {value} without a name; write {ways}") from None
        takes = Signature(own)
        raise UsageError(f"{name}: {error}; it takes {takes}") from None


def _returning_result(verb: Callable[P, T]) -> Callable[P, T]:
    """Show the result of the job as the return type in a verb's signature."""
    result = verb.__annotations__["return"].removeprefix("Job[").removesuffix("]")
    verb.__annotations__ = {**verb.__annotations__, "return": result}
    verb.__signature__ = signature(verb).replace(return_annotation=result)  # type: ignore[attr-defined]
    return verb
