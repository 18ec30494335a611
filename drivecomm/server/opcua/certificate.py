"""What an OPC UA server shows who it is by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Certificate:
    """What a server shows who it is by. certificate, key: objects of the package cryptography."""

    certificate: Any
    key: Any
