"""Creation of a drive object for a stop, even if some of its options are invalid."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.protocol import LINE_FACT_NAMES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

T = TypeVar("T")


def make_despite_errors(make: Callable[..., T], options: Mapping[str, Any]) -> tuple[T, str]:
    """Return an object made with these options, or without the invalid ones, and the reason for leaving them out.

    A model whose file is missing is not needed for a stop. The reason is empty if all options are valid. An error that
    occurs even without any options is raised.
    """
    try:
        return make(**options), ""
    except Exception as error:  # noqa: BLE001 - the motor must be stopped in spite of any error
        why = str(error)
    facts = {name: value for name, value in options.items() if name in LINE_FACT_NAMES}
    try:
        return make(**facts), f"without its options: {why}"
    except Exception:  # noqa: BLE001 - as above
        return make(), f"without its options: {why}"
