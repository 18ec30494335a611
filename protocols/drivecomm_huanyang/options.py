"""Differences between Huanyang drives that are independent of a model's parameters."""

from __future__ import annotations

from dataclasses import dataclass

from drivecomm.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class HuanyangOptions:
    """Options of a Huanyang drive.

    state_timeout_s: seconds in which a drive must obey a start; otherwise the start is withdrawn. reply_delay_s: reply
    delay of a virtual drive, in seconds.
    """

    state_timeout_s: float = 3.0
    reply_delay_s: float = 0.005

    def __post_init__(self) -> None:
        for name in ("state_timeout_s", "reply_delay_s"):
            if getattr(self, name) < 0:
                raise UsageError(f"{name} of {getattr(self, name)} is negative")
