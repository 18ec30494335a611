"""How a virtual drive refuses: with a code on the line, with an error to whoever asks it besides."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError

if TYPE_CHECKING:
    from collections.abc import Iterator


class Refusal(Exception):  # noqa: N818 - an answer of the drive, not an error of the program
    """The drive refuses, with this code of its protocol."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"code {code}")


@contextmanager
def looked_into(parameter: str) -> Iterator[None]:
    """Raise ParameterAddressError for what is refused when somebody looks into a virtual drive, or sets what it holds.

    There is no access to be checked then, so what is refused does not exist.
    """
    try:
        yield
    except Refusal as refusal:
        raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}") from refusal
