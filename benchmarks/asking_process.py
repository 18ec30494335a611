"""Cheapest possible master of many lines over TCP: sends raw requests in turn and compares raw replies.

It takes one line of JSON: seconds, and places with host, port, and pairs of request and reply in hexadecimal. It prints
a line after everything has been requested twice on each line, because drives take longer for their first requests, and
a line with the results at the end.
"""

from __future__ import annotations

import contextlib
import json
import selectors
import socket
import sys
import time
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_LOST_S = 1.0
_WARM_ROUNDS = 2
_MOST_WARM_UP_S = 60.0


@dataclass(slots=True)
class _Line:
    """State of one line: its exchanges in turn, the results, and the start of the present wait."""

    port: socket.socket
    spoken: Iterator[tuple[bytes, bytes]]
    wanted: bytes = b""
    came: bytes = b""
    since: float = 0.0
    exchanges: int = 0
    lost: int = 0
    wrong: int = 0

    def ask(self) -> None:
        request, self.wanted = next(self.spoken)
        self.came = b""
        self.since = time.perf_counter()
        self.port.sendall(request)

    def hear(self) -> None:
        self.came += self.port.recv(4096)
        if len(self.came) < len(self.wanted):
            return
        if self.came == self.wanted:
            self.exchanges += 1
        else:
            self.wrong += 1
        self.ask()

    def give_up(self) -> None:
        self.lost += 1
        self.ask()


def main() -> None:
    """Send requests for the given time, and print the results."""
    told = json.loads(sys.stdin.readline())
    with contextlib.ExitStack() as opened, selectors.DefaultSelector() as selector:
        lines = []
        for place in told["places"]:
            port = opened.enter_context(socket.create_connection((place["host"], place["port"])))
            port.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            spoken = [(bytes.fromhex(request), bytes.fromhex(reply)) for request, reply in place["spoken"]]
            line = _Line(port, cycle(spoken))
            selector.register(port, selectors.EVENT_READ, line)
            lines.append(line)
        for line in lines:
            line.ask()
        rounds = [_WARM_ROUNDS * len(place["spoken"]) for place in told["places"]]

        def is_warm() -> bool:
            return all(line.exchanges >= enough for line, enough in zip(lines, rounds, strict=True))

        _serve(selector, lines, _MOST_WARM_UP_S, is_warm)
        for line in lines:
            line.exchanges = line.lost = line.wrong = 0
        print(json.dumps({"warm": True}), flush=True)
        began, spent = time.perf_counter(), time.process_time()
        _serve(selector, lines, told["seconds"], lambda: False)
        answer: dict[str, Any] = {
            "seconds": time.perf_counter() - began,
            "processor_s": time.process_time() - spent,
            "lines": [{"exchanges": line.exchanges, "lost": line.lost, "wrong": line.wrong} for line in lines],
        }
        print(json.dumps(answer), flush=True)


def _serve(selector: selectors.BaseSelector, lines: list[_Line], seconds: float, is_enough: Callable[[], bool]) -> None:
    """Send requests and receive replies for this many seconds, or until `is_enough`, which is polled now and then."""
    now = time.perf_counter()
    until, looked = now + seconds, now
    while now < until:
        for key, _ in selector.select(0.1):
            key.data.hear()
        now = time.perf_counter()
        if now - looked > _LOST_S / 4:
            looked = now
            if is_enough():
                return
            for line in lines:
                if now - line.since > _LOST_S:
                    line.give_up()


if __name__ == "__main__":
    main()
