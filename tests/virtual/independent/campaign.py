"""Campaigns: many concurrent talks for some time, watched for hangs."""

from __future__ import annotations

import os
import threading
import time
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_USUAL_S = 3.0
MOST_SILENT_S = 15.0
"""Longest duration of one exchange with all its retries: three times the half second of VABus, and an error read."""


class Talker(Protocol):
    """Master or library side of one drive, which makes an exchange in its turn, and counts."""

    name: str
    exchanges: int
    failed: int
    wrong: list[str]

    def turn(self) -> None:
        """Make one exchange."""
        ...


def seconds() -> float:
    """Return the duration of a campaign in seconds: DRIVECOMM_MINUTES, or a few seconds."""
    given = os.environ.get("DRIVECOMM_MINUTES")
    return float(given) * 60 if given else _USUAL_S


class Campaign:
    """Concurrent talks on several lines, one thread for each line; talks on one line take turns.

    in_a_row: exchanges of one talk before the next one's turn. most_silent_s: a longer exchange counts as a hang.
    hangs, errors: failures found.
    """

    def __init__(
        self, lines: Iterable[Sequence[Talker]], *, in_a_row: int = 1, most_silent_s: float = MOST_SILENT_S
    ) -> None:
        self._in_a_row = in_a_row
        self._lines = [list(line) for line in lines]
        self._most_silent_s = most_silent_s
        self._stop = threading.Event()
        self._since = [0.0] * len(self._lines)
        self.slowest_s = 0.0
        self.hangs: list[str] = []
        self.errors: list[str] = []

    @property
    def talkers(self) -> list[Talker]:
        """All talks of the campaign."""
        return [talker for line in self._lines for talker in line]

    def run(self, duration_s: float) -> None:
        """Run all talks for this time in seconds."""
        threads = [
            threading.Thread(target=self._talk, args=(number, line), daemon=True)
            for number, line in enumerate(self._lines)
        ]
        began = time.monotonic()
        self._since = [began] * len(self._lines)
        for thread in threads:
            thread.start()
        while time.monotonic() - began < duration_s and any(thread.is_alive() for thread in threads):
            time.sleep(0.1)
            self._look_for_hangs()
        self._stop.set()
        until = time.monotonic() + self._most_silent_s
        for thread in threads:
            thread.join(max(0.0, until - time.monotonic()))
        self.hangs += [f"line {number} does not end" for number, thread in enumerate(threads) if thread.is_alive()]

    def report(self, title: str) -> str:
        """Return the results, with one row for each talk."""
        rows = [f"{title}: slowest exchange {self.slowest_s:.2f} s, {len(self.hangs)} hangs"]
        rows += [
            f"  {talker.name:<32} {talker.exchanges:>7} exchanges {getattr(talker, 'repeats', 0):>6} repeated "
            f"{talker.failed:>4} failed {len(talker.wrong):>3} wrong"
            for talker in self.talkers
        ]
        exchanges = sum(talker.exchanges for talker in self.talkers)
        failed = sum(talker.failed for talker in self.talkers)
        wrong = sum(len(talker.wrong) for talker in self.talkers)
        return "\n".join([*rows, f"  {'all':<32} {exchanges:>7} exchanges {failed:>18} failed {wrong:>3} wrong"])

    def judge(self, *, most_failed: float) -> None:
        """Assert that nothing was wrong, nothing hung, and at most this share of each talk's exchanges failed."""
        assert not self.errors, self.errors
        assert not self.hangs, self.hangs
        wrong = [text for talker in self.talkers for text in talker.wrong]
        assert not wrong, "\n".join(wrong[:10])
        for talker in self.talkers:
            assert talker.exchanges > 0, f"{talker.name} was never heard"
            assert talker.failed <= 2 + most_failed * talker.exchanges, (talker.name, talker.exchanges, talker.failed)

    def _talk(self, number: int, line: list[Talker]) -> None:
        try:
            # Each talk makes at least one exchange on a machine of any speed.
            for talker in line:
                self._turn(number, talker)
            while not self._stop.is_set():
                for talker in line:
                    for _ in range(self._in_a_row):
                        if not self._stop.is_set():
                            self._turn(number, talker)
        except Exception as error:  # noqa: BLE001 - the test reports any error
            self.errors.append(f"{line[0].name}: {type(error).__name__}: {error}")

    def _turn(self, number: int, talker: Talker) -> None:
        began = time.monotonic()
        self._since[number] = began
        talker.turn()
        self.slowest_s = max(self.slowest_s, time.monotonic() - began)

    def _look_for_hangs(self) -> None:
        now = time.monotonic()
        for number, since in enumerate(self._since):
            if now - since > self._most_silent_s and not any(text.startswith(f"line {number} ") for text in self.hangs):
                self.hangs.append(f"line {number} has been silent for {now - since:.0f} s")
