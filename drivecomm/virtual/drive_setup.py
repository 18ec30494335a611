"""What somebody who stands in place of a virtual drive leaves to it: address, line settings, gap, motor, codec."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

if TYPE_CHECKING:
    from drivecomm.protocol import VirtualDrive

T = TypeVar("T")


class OfDrive(Generic[T]):
    """An attribute that is the drive's own: `address = OfDrive[int]()` in a class whose `inner` is the drive.

    It is read from the drive and set there, so that what a parameter write has changed is seen from both sides.
    """

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self._name = name

    @overload
    def __get__(self, stand_in: None, owner: type[Any]) -> OfDrive[T]: ...
    @overload
    def __get__(self, stand_in: Any, owner: type[Any]) -> T: ...
    def __get__(self, stand_in: Any, owner: type[Any]) -> OfDrive[T] | T:
        """Return what the drive has."""
        if stand_in is None:
            return self
        inner: VirtualDrive = stand_in.inner
        value: T = getattr(inner, self._name)
        return value

    def __set__(self, stand_in: Any, value: T) -> None:
        """Set it in the drive."""
        setattr(stand_in.inner, self._name, value)
