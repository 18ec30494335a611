"""A proxy for a virtual drive that forwards every call which a subclass does not override.

class Late(DriveProxy):
    def hear(self, find, now):
        reply = super().hear(find, now)
        return reply and replace(reply, delay_s=2.0)
"""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING, Any

from drivecomm.virtual.station import Follows, Mishears, Restarts

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Codec, Damaged, Framed, LineSettings, Motor, VirtualDrive, VirtualReply


def _of_drive(name: str) -> Any:
    """Return a property for an attribute of the drive itself, so that changes by parameter writes show in the proxy."""
    return property(attrgetter(f"inner.{name}"), lambda proxy, value: setattr(proxy.inner, name, value))


class DriveProxy:
    """Proxy for the virtual drive `inner`. Times are converted by `time_of`.

    mishear: present only if the drive uses characters that are not a telegram.
    """

    mishear: Callable[[float], None]

    address: int = _of_drive("address")
    settings: LineSettings = _of_drive("settings")
    gap_s: float = _of_drive("gap_s")
    motor: Motor = _of_drive("motor")

    def __init__(self, inner: VirtualDrive) -> None:
        self.inner = inner
        if isinstance(inner, Mishears):
            self.mishear = self._mishear

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.inner!r}>"

    @property
    def codec(self) -> Codec:
        """The codec of the drive."""
        return self.inner.codec

    def time_of(self, now: float) -> float:
        """Convert a time of the line to the time of the drive."""
        return now

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Deliver a request to the drive; return its reply, None for silence."""
        return self.inner.hear(find, self.time_of(now))

    def peek(self, parameter: str, now: float) -> int | str:
        """Return the value of a parameter. Raises ParameterAddressError."""
        return self.inner.peek(parameter, self.time_of(now))

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set the value of a parameter. Raises ParameterAddressError."""
        self.inner.poke(parameter, raw)

    def trip(self, code: int, now: float) -> None:
        """Make the drive trip."""
        self.inner.trip(code, self.time_of(now))

    def power_cycle(self, now: float) -> None:
        """Reset the state that a real drive loses without power, if the drive supports this."""
        if isinstance(self.inner, Restarts):
            self.inner.power_cycle(self.time_of(now))

    def follow(self, now: float) -> None:
        """Advance the time of a drive that acts by itself."""
        if isinstance(self.inner, Follows):
            self.inner.follow(self.time_of(now))

    def _mishear(self, now: float) -> None:
        inner: Any = self.inner
        inner.mishear(self.time_of(now))

    def overhear(self, now: float) -> None:
        """Notify the drive of a valid telegram to another drive, if it uses that."""
        # This runs for each telegram, and a check for `Overhears` takes longer than the lookup.
        if (overhear := getattr(self.inner, "overhear", None)) is not None:
            overhear(self.time_of(now))
