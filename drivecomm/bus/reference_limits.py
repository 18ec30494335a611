"""Highest reference that a drive accepts; a higher one is refused before it is sent."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import RefusedError, ValueRefusedError

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Capabilities, Exchange, Reading


class ReferenceLimits:
    """Limits of one drive's references.

    name: name of the drive. capabilities: returns the drive's capabilities, with its limit in per cent. maximum:
    returns an exchange that reads the drive's maximum frequency; None if no parameter is known to hold it.
    """

    def __init__(
        self, name: str, capabilities: Callable[[], Capabilities], maximum: Callable[[], Exchange[Reading] | None]
    ) -> None:
        self._name, self._capabilities, self._maximum = name, capabilities, maximum
        self._allowed_hz = Decimal(0)

    def check_percent(self, percent: Decimal) -> None:
        """Raise ValueRefusedError for a reference in per cent above the drive's limit, in either direction."""
        capabilities = self._capabilities()
        limit = capabilities.reference_limit
        # A drive without references in per cent refuses them for that reason.
        if capabilities.reference_percent and abs(percent) > limit:
            raise ValueRefusedError(
                f"a reference of {percent} % is above {limit} %, "
                + ("the maximum of the reference range" if limit == 100 else "the reference_limit")
                + f" of {self._name}"
            )

    def check_hz(self, hz: Decimal) -> None:
        """Raise ValueRefusedError for a frequency above the limit in the drive's options, if they set one."""
        limit = self._capabilities().reference_limit_hz
        if limit is not None and abs(hz) > limit:
            raise ValueRefusedError(
                f"a reference of {hz} Hz is above {limit.normalize():f} Hz, the maximum that the options of "
                f"{self._name} allow"
            )

    def within(self, hz: Decimal, setting: Exchange[None]) -> Exchange[None]:
        """Set a frequency, unless it is above the drive's maximum: then only that maximum is read.

        The maximum is read once, and again before a frequency is refused. setting: exchange that sets the frequency,
        not begun yet. Raises ValueRefusedError.
        """
        if abs(hz) > self._allowed_hz:
            yield from self._read_maximum(hz, setting)
        yield from setting

    def forget(self) -> None:
        """Read the maximum again for the next frequency, because a parameter of the drive is written."""
        self._allowed_hz = Decimal(0)

    def _read_maximum(self, hz: Decimal, setting: Exchange[None]) -> Exchange[None]:
        reading = self._maximum()
        if reading is None:
            return
        try:
            found = yield from reading
        except RefusedError:
            # Some drives of a series refuse to report their maximum.
            return
        if found.unit != "Hz" or isinstance(found.value, str) or found.value <= 0:
            return
        maximum = Decimal(found.value)
        if abs(hz) > maximum:
            setting.close()
            raise ValueRefusedError(
                f"a reference of {hz} Hz is above {found}, the maximum frequency of {self._name} "
                f"(parameter {found.parameter})"
            )
        self._allowed_hz = maximum
