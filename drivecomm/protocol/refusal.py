"""Refusals of a virtual drive: by a code on the line, by an error for a caller that looks into the drive."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError

if TYPE_CHECKING:
    from collections.abc import Iterator


class Refusal(Exception):  # noqa: N818 - a reply of the drive, not an error of the program
    """Refusal of a request by the drive, with a code of its protocol."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"code {code}")


@contextmanager
def looked_into(parameter: str) -> Iterator[None]:
    """Raise ParameterAddressError for a refusal while a caller reads or sets values inside a virtual drive.

    No access is checked then, so a refused parameter is one that does not exist.
    """
    try:
        yield
    except Refusal as refusal:
        raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}") from refusal
