"""Private data, left out of a proof by default: serial numbers, names, and addresses of drives and networks."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import ParameterInfo

LEFT_OUT = "(left out)"

_PRIVATE = re.compile(
    r"serial|address|\bname|_name|\bnode\b|password|customer|user|station|network|gateway|host|\bmac\b|\bip\b|order"
    r"|text|plant|site|comment|production|pin\b",
    re.IGNORECASE,
)
_PUBLIC_IDENTITY = re.compile(
    r"^(?!.*(serial|order|name|address)).*(type|software|firmware|version|family|module|model|power section|voltage"
    r"|capacity|product|vendor|region|software)",
    re.IGNORECASE,
)
_PUBLIC_TEXTS = frozenset({"software_version", "drive_type"})


def is_private(info: ParameterInfo, common: str, value: object) -> bool:
    """Whether a parameter's value may reveal the individual drive or its owner. common: its common name, or empty."""
    if common in _PUBLIC_TEXTS:
        return False
    return isinstance(value, str) or any(map(_PRIVATE.search, (info.name.replace("_", " "), info.title, common)))


def public_identity(identity: Mapping[str, str], named_by_model: Mapping[str, str]) -> dict[str, str]:
    """Return the identity of a drive without the details that distinguish it from others of its series."""
    return {
        key: text for key, text in identity.items() if key in named_by_model or _PUBLIC_IDENTITY.search(key) is not None
    }
