"""Whether a drive may take the place of one whose parameter set was approved: same type and size, another unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.bus import carry_out
from drivecomm.commissioning.exploring import identity_told, lasting

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import Drive
    from drivecomm.commissioning.parameter_sets import ParameterSet

_OF_ONE_UNIT = "serial"
"""In the name of what tells one unit from another of the same type."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Replacement:
    """A drive on the line compared with the drive of an approved set, by what both report of themselves.

    differs: how type or size differ, as sentences; a drive with any must not get the set. not_told: what the approved
    drive reported of its type and size, and this one does not. has_type: whether the approved drive reported type or
    size at all. unchanged: the serial number, if it is still the approved drive, otherwise empty. serials: each serial
    number, as it was approved and as it is now.
    """

    differs: tuple[str, ...] = ()
    not_told: tuple[str, ...] = ()
    has_type: bool = False
    unchanged: str = ""
    serials: tuple[tuple[str, str, str], ...] = ()

    @property
    def needs_name_plate(self) -> bool:
        """Whether a person must compare the name plates, since the drive does not report all of its type and size."""
        return not self.has_type or bool(self.not_told)


def compare_identities(approved: Mapping[str, str], now: Mapping[str, str]) -> Replacement:
    """Compare what a drive reports of itself with what the drive of an approved set reported.

    Software versions and hours do not count: a new drive has others.
    """
    lasts = lasting(approved)
    serials = {key: text for key, text in lasts.items() if _OF_ONE_UNIT in key.lower()}
    of_type = {key: text for key, text in lasts.items() if key not in serials}
    compared = [(key, text, now[key]) for key, text in serials.items() if now.get(key)]
    is_same = bool(compared) and all(before == after for _, before, after in compared)
    return Replacement(
        differs=tuple(
            f"its {key} is {now[key]!r}, and {text!r} in the approved set"
            for key, text in of_type.items()
            if key in now and now[key] != text
        ),
        not_told=tuple(key for key in of_type if key not in now),
        has_type=bool(of_type),
        unchanged=compared[0][1] if is_same else "",
        serials=tuple(compared),
    )


def check_replacement(drive: Drive, approved: ParameterSet) -> Replacement:
    """Ask a drive what it is, and compare it with the drive of an approved set; writes nothing.

    Raises ReplyError and LinkError when drive or line are away.
    """
    return compare_identities(approved.identity, carry_out(drive, identity_told()))
