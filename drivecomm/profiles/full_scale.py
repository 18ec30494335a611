"""The full scale of references in per cent, if parameters of the drive hold it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from drivecomm.protocol import Model

_NEEDED, _KEYS = {"maximum", "source"}, {"maximum", "minimum", "source"}


@dataclass(frozen=True, slots=True, kw_only=True)
class FullScale:
    """The parameters that hold the frequencies of a reference of 100 % and of 0 %.

    maximum, minimum: their addresses; without a minimum, 0 % is 0 Hz. source: the document and page that state this.
    """

    maximum: str
    source: str
    minimum: str = ""

    @property
    def addresses(self) -> tuple[str, ...]:
        """Addresses of the parameters to read, the one of 100 % first."""
        return tuple(filter(None, (self.maximum, self.minimum)))


def full_scale_of(model: Model) -> FullScale | None:
    """Return the full scale from the key `full_scale` of a [control], if it has one. Raises UsageError if invalid."""
    given: Any = model.control.get("full_scale")
    if given is None:
        return None
    if not isinstance(given, Mapping) or not _NEEDED <= given.keys() <= _KEYS or not all(given.values()):
        raise UsageError(
            "[control] full_scale: write { maximum = ..., minimum = ..., source = ... }; minimum may be left out"
        )
    found = FullScale(**given)
    for address in found.addresses:
        info = model.find(address)
        if info is None:
            raise UsageError(f"[control] full_scale: {address!r} is not a parameter of the model")
        if info.unit != "Hz":
            raise UsageError(f"[control] full_scale: parameter {address} is in {info.unit or 'no unit'}, not in Hz")
    if not model.control.get("reference_percent"):
        raise UsageError("[control] full_scale: it is of reference_percent, which is missing")
    return found
