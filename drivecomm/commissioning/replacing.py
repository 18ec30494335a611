"""Check of a replacement drive: it must have the same type and size as the drive whose parameter set was approved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.bus import carry_out
from drivecomm.commissioning.exploring import lasting_identity, read_identity

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import Drive
    from drivecomm.commissioning.parameter_sets import ParameterSet

_OF_ONE_UNIT = "serial"
"""Part of the name of an identity field that differs between units of the same type."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Replacement:
    """Comparison of a drive on the line with the drive of an approved set, by the identity that both report.

    differs: differences in type or size, as sentences; a drive with any difference must not get the set. not_told: type
    and size fields that the approved drive reported and this drive does not. has_type: whether the approved drive
    reported its type or size at all. unchanged: the serial number if it is still the approved drive, otherwise empty.
    serials: each serial number, as approved and as it is now.
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
    """Compare the identity that a drive reports with the identity of the drive of an approved set.

    Software versions and operating hours are ignored, because they differ in a new drive.
    """
    lasts = lasting_identity(approved)
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
    """Read the identity of a drive and compare it with the drive of an approved set; writes nothing.

    Raises ReplyError or LinkError if the drive or the line does not respond.
    """
    return compare_identities(approved.identity, carry_out(drive, read_identity()))
