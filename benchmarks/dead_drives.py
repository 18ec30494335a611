"""Cost of dead drives for the live ones, in virtual time: no emulator, no noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

from conversation import READS
from report import Figure, Section

import drivecomm
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from equipment import Equipment

_LIVE = (1, 11, 21)
_ADDRESSES = range(1, 32)
_FIRST_MINUTE_S = 60.0
_PROMISE = 0.95
# The documented times, to the nearest second: with slow telegrams, dead drives cannot be probed any sooner.
_BACK_WITHIN_S = {"vabus": 10.0, "danfoss-fc": 10.0, "vlt3500": 28.5, "fuji": 22.5}
_PATIENCE_S = 300.0


def measure(equipment: Equipment) -> list[Section]:
    """Measure every protocol."""
    section = Section(
        title="Dead drives",
        about=(
            "31 configured drives (VABus: 30, it has no more addresses), three of them alive, read one after the other "
            "again and again; virtual time. Reads of the live ones a second, alone and beside the dead ones after the "
            "first minute, and how long after a dead drive came to life it was read."
        ),
        head=("protocol", "alone", "beside the dead", "share", "back after s"),
    )
    for protocol in READS:
        plugin = drivecomm.protocols()[protocol]
        dead = [address for address in _ADDRESSES if address in plugin.addresses and address not in _LIVE]
        window = equipment.extent.virtual_seconds
        alone = _rate(protocol, [], window)[0]
        beside, back = _rate(protocol, dead, window)
        section.rows.append((protocol, f"{alone:.1f}", f"{beside:.1f}", f"{beside / alone:.3f}", f"{back:.1f}"))
        section.figures += [
            Figure(
                name=f"share of the live ones, {protocol}",
                value=beside / alone,
                promise=_PROMISE,
                floor=_PROMISE,
                exact=True,
            ),
            Figure(
                name=f"s until a drive that came back is read, {protocol}",
                value=back,
                promise=_BACK_WITHIN_S[protocol],
                floor=_BACK_WITHIN_S[protocol],
                better="less",
                exact=True,
            ),
        ]
    return [section]


class _Sleeper:
    """A virtual drive that does not answer until it is awake."""

    def __init__(self, drive: drivecomm.protocol.VirtualDrive) -> None:
        self.awake = False
        self.address, self.settings, self.gap_s = drive.address, drive.settings, drive.gap_s
        self.motor, self.codec = drive.motor, drive.codec
        self.peek, self.poke, self.trip = drive.peek, drive.poke, drive.trip
        self._drive = drive

    def hear(
        self, find: drivecomm.framing.Framed | drivecomm.framing.Damaged, now: float
    ) -> drivecomm.protocol.VirtualReply | None:
        """Return the drive's reply if it is awake, otherwise None."""
        return self._drive.hear(find, now) if self.awake else None


def _rate(protocol: str, dead: Sequence[int], window: float) -> tuple[float, float]:
    """Return the reads of live drives per second, and the seconds until a revived drive is read."""
    sleeper = _Sleeper(virtual_drive(protocol, dead[-1])) if dead else None
    line = VirtualLine([*(virtual_drive(protocol, one) for one in _LIVE), *([sleeper] if sleeper else [])])
    with drivecomm.open_bus(line.port) as bus:
        drives = {address: bus.drive(protocol, address) for address in sorted([*_LIVE, *dead])}
        reads = _in_turn(protocol, drives)
        while dead and line.time < _FIRST_MINUTE_S:
            next(reads)
        began, answered = line.time, 0
        while line.time < began + window:
            answered += next(reads) is not None
        rate = answered / (line.time - began)
        if sleeper is None:
            return rate, 0.0
        sleeper.awake = True
        woken = line.time
        while next(reads) != sleeper.address and line.time < woken + _PATIENCE_S:
            pass
        return rate, line.time - woken


def _in_turn(protocol: str, drives: Mapping[int, drivecomm.Drive]) -> Iterator[int | None]:
    """Read the drives in turn forever; yield the address of each drive that answers, None for one that does not."""
    while True:
        for address, drive in drives.items():
            try:
                drive.read(READS[protocol])
            except drivecomm.NoReplyError:
                yield None
            else:
                yield address
