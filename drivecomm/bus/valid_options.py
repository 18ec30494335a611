"""Making a drive for a stop, whatever is wrong with the options that are said of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.protocol import LINE_FACT_NAMES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

T = TypeVar("T")


def as_far_as_possible(make: Callable[..., T], options: Mapping[str, Any]) -> tuple[T, str]:
    """Return what is made with these options, or without those that are invalid, and then why.

    A model whose file is missing is not needed for a stop. What raises without any options, too, is raised.
    """
    try:
        return make(**options), ""
    except Exception as error:  # noqa: BLE001 - whatever it is, a motor must still be stopped
        why = str(error)
    facts = {name: value for name, value in options.items() if name in LINE_FACT_NAMES}
    try:
        return make(**facts), f"without its options: {why}"
    except Exception:  # noqa: BLE001 - as above
        return make(), f"without its options: {why}"
