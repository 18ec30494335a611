"""Sources of bytes: a capture file, or a port that only listens."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.capture import Piece
from drivecomm.traffic.sniffer import LineSample

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import LineSettings
    from drivecomm.transport import ListeningPort

_SUFFIXES = (".jsonl", ".pcapng")
# Limit of the delay in seconds until a silence is noticed.
_TICK_S = 0.05
# An adapter delivers bytes every 16 ms, so shorter silences show only between its deliveries.
_SILENCE_S = 0.005
_SILENCE_CHARACTERS = 3
_NO_LONGER_THAN_S = 4.0


def is_file(place: str) -> bool:
    """Return whether a place is a capture file and not a port."""
    return Path(place).suffix.lower() in _SUFFIXES or Path(place).is_file()


def pieces_from(port: ListeningPort, settings: LineSettings, seconds: float | None) -> Iterator[Piece]:
    """Yield the bytes of a port, and empty pieces during silence; times start now. seconds: None for no end."""
    began = port.now()
    until = None if seconds is None else began + seconds
    while until is None or port.now() < until:
        tick = port.now() + _TICK_S
        data = port.read(tick if until is None else min(tick, until))
        yield Piece(time_s=port.now() - began, data=data, settings=settings)
        # The caller has printed the piece by now.
        sys.stdout.flush()


@dataclass(slots=True)
class DetectionListener:
    """Listener at a port with changing settings, for the detection of line settings."""

    port: ListeningPort

    def listen(self, settings: LineSettings, telegrams: int) -> LineSample:
        """Return the bytes received until a number of silences, for 4 s at most. telegrams: that number."""
        self.port.configure(settings)
        began, spoilt = self.port.now(), self.port.spoilt
        silence_s = max(_SILENCE_S, settings.wire_s(_SILENCE_CHARACTERS))
        pieces: list[Piece] = []
        bursts, last_s = 0, began
        while bursts < telegrams and self.port.now() - began < _NO_LONGER_THAN_S:
            data = self.port.read(self.port.now() + silence_s)
            now = self.port.now()
            if data:
                pieces.append(Piece(time_s=now - began, data=data))
            elif pieces and now - last_s >= silence_s:
                bursts += pieces[-1].time_s + began > last_s
                last_s = max(last_s, pieces[-1].time_s + began)
        return LineSample(pieces=pieces, spoilt=self.port.spoilt - spoilt)
