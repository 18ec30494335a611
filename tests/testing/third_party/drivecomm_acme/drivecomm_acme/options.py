"""What differs between Acme drives."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class AcmeOptions:
    """What differs between Acme drives.

    reply_delay_s: how long a virtual drive takes to answer, in seconds; a real one takes up to 0.15 (section 1).
    """

    reply_delay_s: float = 0.004
