"""Report on an open port, for people who investigate a slow or silent line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from serial.tools import list_ports

from drivecomm.transport.direction import direction
from drivecomm.transport.latency import latency_timer_ms, low_latency
from drivecomm.transport.port_names import stable_name

if TYPE_CHECKING:
    from drivecomm.transport.direction import Direction
    from drivecomm.transport.latency import Latency

PortKind: TypeAlias = Literal["serial port", "pseudo-terminal", "raw TCP", "RFC 2217", "other"]

_SYSFS = Path("/sys/class/tty")
_KINDS: dict[str, PortKind] = {"socket": "raw TCP", "rfc2217": "RFC 2217"}
_USB_SLOW_MS = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class UsbIdentity:
    """Identity of a USB adapter: vendor and product numbers, and texts that are "" if the adapter has none."""

    vendor: int
    product: int
    maker: str = ""
    name: str = ""
    serial_number: str = ""

    def __str__(self) -> str:
        words = " ".join(word for word in (self.maker, self.name, self.serial_number) if word)
        return f"{self.vendor:04x}:{self.product:04x} {words}".rstrip()


@dataclass(frozen=True, slots=True, kw_only=True)
class PortReport:
    """Properties of an open port.

    driver: name in the kernel, "" if unknown. usb: None if it is not a USB adapter. stable_name: name by which the port
    is reopened. low_latency: whether the adapter passes bytes on immediately. latency_timer_ms: longest delay by the
    adapter, None if unknown. rs485: whether the driver controls the direction; off does not imply that it could. notes:
    hints for the user, one sentence each.
    """

    url: str
    kind: PortKind
    driver: str = ""
    usb: UsbIdentity | None = None
    stable_name: str
    low_latency: Latency = "unknown"
    latency_timer_ms: int | None = None
    rs485: Direction = "unsupported"
    notes: tuple[str, ...] = ()


def remote_report(url: str) -> PortReport:
    """Report on a port behind a URL, of which only the kind is known."""
    kind = _KINDS.get(url.partition("://")[0].lower(), "other")
    notes: tuple[str, ...] = ()
    if kind == "raw TCP":
        notes = ("the server has its own line settings and its own latency",)
    return PortReport(url=url, kind=kind, stable_name=url, notes=notes)


def local_report(port: Any, name: str, *, pseudo: bool, sysfs: Path = _SYSFS) -> PortReport:
    """Report on an open local port. port: object of pyserial."""
    if pseudo:
        return PortReport(url=name, kind="pseudo-terminal", stable_name=stable_name(name))
    usb, latency, timer = _usb(name), low_latency(port, name, sysfs), latency_timer_ms(name, sysfs)
    return PortReport(
        url=name,
        kind="serial port",
        driver=_driver(name, sysfs),
        usb=usb,
        stable_name=stable_name(name),
        low_latency=latency,
        latency_timer_ms=timer,
        rs485=direction(port),
        notes=_notes(usb, timer, console=_is_console(name, sysfs)),
    )


def _driver(name: str, sysfs: Path) -> str:
    link = sysfs / Path(name).resolve().name / "device" / "driver"
    return link.resolve().name if link.exists() else ""


def _usb(name: str) -> UsbIdentity | None:
    real = str(Path(name).resolve())
    for found in list_ports.comports():
        if found.device in (name, real) and found.vid is not None:
            return UsbIdentity(
                vendor=found.vid,
                product=found.pid or 0,
                maker=found.manufacturer or "",
                name=found.product or "",
                serial_number=found.serial_number or "",
            )
    return None


def _is_console(name: str, sysfs: Path) -> bool:
    try:
        return (sysfs / Path(name).resolve().name / "console").read_text().strip() == "Y"
    except OSError:
        return False


def _notes(usb: UsbIdentity | None, timer: int | None, *, console: bool) -> tuple[str, ...]:
    notes = []
    if console:
        notes.append("the kernel writes its messages to this port; remove it from the boot parameter console=")
    if timer is not None and timer > _USB_SLOW_MS:
        notes.append(f"the adapter holds received bytes back for up to {timer} ms; low-latency mode is not on")
    if usb is not None and not usb.serial_number:
        notes.append("the adapter has no serial number, so another adapter of the same type looks identical")
    return tuple(notes)
