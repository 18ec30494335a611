"""A stand-in for a virtual drive that passes on to it whatever a subclass does not change.

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
    """An attribute of the drive itself, so that what a parameter write has changed is seen from both sides."""
    return property(attrgetter(f"inner.{name}"), lambda proxy, value: setattr(proxy.inner, name, value))


class DriveProxy:
    """Stands in for the virtual drive `inner`; times are passed on as `time_of` says.

    mishear: there only where the drive takes note of characters that are no telegram.
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
        """The telegrams that the drive understands."""
        return self.inner.codec

    def time_of(self, now: float) -> float:
        """Return the time of the drive at a time of the line."""
        return now

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Let the drive act on a request."""
        return self.inner.hear(find, self.time_of(now))

    def peek(self, parameter: str, now: float) -> int | str:
        """Return what the drive holds. Raises ParameterAddressError."""
        return self.inner.peek(parameter, self.time_of(now))

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what the drive holds. Raises ParameterAddressError."""
        self.inner.poke(parameter, raw)

    def trip(self, code: int, now: float) -> None:
        """Make the drive trip."""
        self.inner.trip(code, self.time_of(now))

    def power_cycle(self, now: float) -> None:
        """Let the drive forget what a real one forgets without power, if it does."""
        if isinstance(self.inner, Restarts):
            self.inner.power_cycle(self.time_of(now))

    def follow(self, now: float) -> None:
        """Let the drive do what it does by itself."""
        if isinstance(self.inner, Follows):
            self.inner.follow(self.time_of(now))

    def _mishear(self, now: float) -> None:
        inner: Any = self.inner
        inner.mishear(self.time_of(now))

    def overhear(self, now: float) -> None:
        """Let the drive take note of a valid telegram to another one, if it uses that."""
        # Asked for each telegram, and a check for `Overhears` takes longer than what follows.
        if (overhear := getattr(self.inner, "overhear", None)) is not None:
            overhear(self.time_of(now))
