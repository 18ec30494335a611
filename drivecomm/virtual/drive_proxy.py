"""A stand-in for a virtual drive that passes on to it whatever a subclass does not change.

class Late(DriveProxy):
def hear(self, find, now):
reply = super().hear(find, now)
return reply and replace(reply, delay_s=2.0)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

from drivecomm.protocol import LineSettings, Motor
from drivecomm.virtual.station import Follows, Overhears, Restarts

if TYPE_CHECKING:
    from drivecomm.protocol import Codec, Damaged, Framed, VirtualDrive, VirtualReply

T = TypeVar("T")


class _OfDrive(Generic[T]):
    """An attribute of the drive itself, so that what a parameter write has changed is seen from both sides."""

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self._name = name

    @overload
    def __get__(self, proxy: None, owner: type[Any]) -> _OfDrive[T]: ...
    @overload
    def __get__(self, proxy: DriveProxy, owner: type[Any]) -> T: ...
    def __get__(self, proxy: DriveProxy | None, owner: type[Any]) -> _OfDrive[T] | T:
        if proxy is None:
            return self
        value: T = getattr(proxy.inner, self._name)
        return value

    def __set__(self, proxy: DriveProxy, value: T) -> None:
        setattr(proxy.inner, self._name, value)


class DriveProxy:
    """Stands in for the virtual drive `inner`; times are passed on as `time_of` says."""

    address = _OfDrive[int]()
    settings = _OfDrive[LineSettings]()
    gap_s = _OfDrive[float]()
    motor = _OfDrive[Motor]()

    def __init__(self, inner: VirtualDrive) -> None:
        self.inner = inner

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

    def overhear(self, now: float) -> None:
        """Let the drive take note of a valid telegram to another one, if it uses that."""
        if isinstance(self.inner, Overhears):
            self.inner.overhear(self.time_of(now))
