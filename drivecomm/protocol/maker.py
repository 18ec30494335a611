"""Fast constructors for frozen dataclasses of which thousands of values are made in a second."""

from __future__ import annotations

from dataclasses import MISSING, fields
from inspect import cleandoc
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec("P")
T = TypeVar("T")


def maker(kind: Callable[P, T]) -> Callable[P, T]:
    """Return a faster replacement for the constructor of a frozen dataclass with slots.

    The replacement takes keyword arguments only, and needs a third of the time. The constructor of a frozen dataclass
    bypasses the guard against changes for each field. This function fills in the fields of a class without a guard and
    then changes the class of the value to the frozen one. A field with a default factory must be given. Raises
    TypeError for a class with `__post_init__`.
    """
    known: Any = kind
    if hasattr(known, "__post_init__"):
        raise TypeError(f"{known.__name__} looks at its fields when it is made")
    names = [each.name for each in fields(known)]
    blank = type(f"Blank{known.__name__}", (), {"__slots__": names})
    within = {"new": object.__new__, "blank": blank, "kind": kind}
    within |= {f"_{each.name}": each.default for each in fields(known)}
    given = [each.name if each.default is MISSING else f"{each.name}=_{each.name}" for each in fields(known)]
    filled = "".join(f"    made.{name} = {name}\n" for name in names)
    text = (
        f"def make(*, {', '.join(given)}):\n    made = new(blank)\n{filled}    made.__class__ = kind\n    return made\n"
    )
    # Generated, as dataclasses generate their constructor, since a loop over the fields would be slower than that.
    exec(text, within)  # noqa: S102 - only of the names of fields
    made: Any = within["make"]
    made.__name__ = made.__qualname__ = known.__name__
    made.__doc__ = f"Return a {known.__name__}, as its constructor does and faster.\n\n{cleandoc(known.__doc__)}"
    return cast("Callable[P, T]", made)
