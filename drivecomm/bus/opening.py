"""What a line is opened with: the same options for `open_bus` and `open_bus_async`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict

from drivecomm.bus.roster import Roster
from drivecomm.errors import UsageError, shortened

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.capture import Record
    from drivecomm.link import Echo, Port, TraceEvent
    from drivecomm.protocol import Parity


class LineOptions(TypedDict, total=False):
    """The options of `open_bus` and `open_bus_async`.

    Line settings and timing hold for all drives, instead of their protocols' defaults; None is as not given.
    """

    baudrate: int | None
    bytesize: int | None
    parity: Parity | None
    stopbits: float | None
    reply_timeout_s: float | None
    """From the last character of a request to the first of the reply."""
    attempts: int | None
    """How often a request is sent at most, when repeating it is safe."""
    deadline_s: float | None
    """How long one call may take in all."""
    gap_s: float | None
    """The longest pause inside a telegram."""
    gap_characters: float | None
    """The same in character times."""
    turnaround_s: float | None
    """From the end of a reply to the next request."""
    turnaround_characters: float | None
    """The same in character times."""
    request_interval_s: float | None
    """From one request to a drive to the next one to it."""
    broadcast_pause_s: float | None
    """From the end of a broadcast to the next request."""
    late_s: float | None
    """How long after its time a reply may still come."""
    echo: bool | Echo
    """Whether the adapter hands back what it sends: "off" unless given, "expect" or True, "auto" to see by itself."""
    guard_s: float
    """Quiet time after a change of line settings, 0.005 unless given."""
    rs485: bool
    """Let the driver of the port switch the transmitter."""
    low_latency: bool | None
    """Whether a USB adapter shall hand bytes over at once; None, or nothing, does so where it can be set."""
    trace: Callable[[TraceEvent], None] | None
    """Called for everything that happens on the line."""
    record: Record | None
    """A file that gets every byte sent and received, .jsonl or .pcapng, or an object with `add(piece)`."""
    stored_writes_per_hour: int
    """How often one parameter of a drive may be written to EEPROM."""


_ROSTER = ("trace", "echo", "guard_s", "stored_writes_per_hour")
_PORT = ("rs485", "low_latency")


def opened_with(
    port: str | Callable[[], Port], options: Mapping[str, Any]
) -> tuple[Callable[[], Port], Roster, Callable[[], None] | None]:
    """Return what a bus is made of: what opens its port, its drives, and what ends its record."""
    facts = dict(options)
    of_roster, of_port = ({name: facts.pop(name) for name in names if name in facts} for names in (_ROSTER, _PORT))
    record = facts.pop("record", None)
    name = port if isinstance(port, str) else ""
    roster, opener = Roster(facts, **of_roster, port=name), port_opener(port, **of_port)
    if record is None:
        return opener, roster, None
    # Files and their formats are for those who record.
    from drivecomm.capture import Recording

    recording = Recording(opener, record, name=name, echo=roster.echo, drives=roster.names)
    return recording.open_port, roster, recording.close


def port_opener(
    port: str | Callable[[], Port], *, rs485: bool = False, low_latency: bool | None = None
) -> Callable[[], Port]:
    """Return what opens this port, and opens it again when it was lost: then by the name that follows the adapter."""
    if not isinstance(port, str):
        if not callable(port):
            raise UsageError(f"port cannot be {shortened(port)}; give its name, or a function that returns a port")
        return port
    names = [port]

    def open_port() -> Port:
        # pyserial is loaded by those who open a port, not by those who import drivecomm.
        from drivecomm.transport import SerialPort

        opened = SerialPort(names[0], rs485=rs485, low_latency=low_latency)
        names[0] = opened.stable_name
        return opened

    return open_port
