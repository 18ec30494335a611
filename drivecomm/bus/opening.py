"""Opening of a line with its options, the same for `open_bus` and `open_bus_async`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.bus.line_drives import LineDrives
from drivecomm.bus.line_options import check_line_options
from drivecomm.errors import UsageError, shortened

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.link import Port


_ROSTER = ("trace", "echo", "guard_s", "stored_writes_per_hour")
_PORT = ("rs485", "low_latency")


def opened_with(
    port: str | Callable[[], Port], options: Mapping[str, Any]
) -> tuple[Callable[[], Port], LineDrives, Callable[[], None] | None]:
    """Return the parts of a bus: a function that opens its port, its drives, and a function that ends its record."""
    check_line_options(options)
    facts = dict(options)
    of_roster, of_port = ({name: facts.pop(name) for name in names if name in facts} for names in (_ROSTER, _PORT))
    record = facts.pop("record", None)
    name = port if isinstance(port, str) else ""
    roster, opener = LineDrives(facts, **of_roster, port=name), port_opener(port, **of_port)
    if record is None:
        return opener, roster, None
    # Imported here, because only recording needs files and their formats.
    from drivecomm.capture import Recording

    recording = Recording(opener, record, name=name, echo=roster.echo, drives=roster.names)
    return recording.open_port, roster, recording.close


def port_opener(
    port: str | Callable[[], Port], *, rs485: bool = False, low_latency: bool | None = None
) -> Callable[[], Port]:
    """Return a function that opens this port, or opens it again after a loss.

    After a loss it uses the system's stable name of the adapter, in case the port's name has changed.
    """
    if not isinstance(port, str):
        if not callable(port):
            raise UsageError(f"invalid port = {shortened(port)}; give its name, or a function that returns a port")
        return port
    names = [port]

    def open_port() -> Port:
        # Imported here, because only opening a port needs pyserial.
        from drivecomm.transport import SerialPort

        opened = SerialPort(names[0], rs485=rs485, low_latency=low_latency)
        names[0] = opened.stable_name
        return opened

    return open_port
