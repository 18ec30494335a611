"""Answer of a drive to one request."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.protocol import ParameterInfo, Reading


@dataclass(frozen=True, slots=True, kw_only=True)
class AddressAnswer:
    """Answer of a drive to the request for one address.

    told: the value of the address or the description of the parameter; None if the drive gave neither. absent: the
    drive says that it has no such parameter or element. code: code of the refusal. reason: why there is no value, as a
    sentence.
    """

    address: str
    told: Reading | ParameterInfo | None = None
    absent: bool = False
    code: int | None = None
    reason: str = ""
