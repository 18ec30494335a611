"""Options of Acme drives."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class AcmeOptions:
    """Options of an Acme drive.

    reply_delay_s: reply delay of a virtual drive in seconds; a real drive takes up to 0.15 (section 1).
    """

    reply_delay_s: float = 0.004
