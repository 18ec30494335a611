"""Clients of a server in a separate process: streams that are read or never read, a page, and a scraper.

Usage: python server_clients.py HOST:PORT, and a line of JSON with seconds, readers, idle. It prints a line when all
clients are connected, and a line of JSON with the observations: the ages of values on arrival at the first reader.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from statistics import median
from typing import Any

_WARM_UP_S, _GREETED_A_SECOND = 2.0, 100.0


async def main(place: str) -> None:
    """Run the clients and print their observations."""
    asked = json.loads(sys.stdin.readline())
    host, _, port = place.rpartition(":")
    ages: list[float] = []
    others: list[int] = []
    warm_s = _WARM_UP_S + asked["readers"] / _GREETED_A_SECOND
    end = time.monotonic() + warm_s + asked["seconds"]
    tasks = [
        asyncio.create_task(_read_stream(host, int(port), "", lambda value: ages.append(_age(value)))),
        asyncio.create_task(_scrape(host, int(port), end)),
        *(
            asyncio.create_task(_read_on(host, int(port), f"?drives=d{number % 50}-1,d{number % 50}-2&every=1", others))
            for number in range(asked["readers"])
        ),
    ]
    idle = [await asyncio.open_connection(host, int(port)) for _ in range(asked["idle"])]
    for _, writer in idle:
        writer.write(_request("GET", "/api/v1/stream", host))
    # Give the server time to accept a crowd of clients first.
    await asyncio.sleep(warm_s)
    ages.clear()
    print("ready", flush=True)
    await asyncio.sleep(max(0.0, end - time.monotonic()))
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    ordered = sorted(ages) or [0.0]
    print(
        json.dumps(
            {
                "values": len(ages),
                "p50_s": median(ordered),
                "p99_s": ordered[int(0.99 * (len(ordered) - 1))],
                "read_by_others": sum(others),
            }
        ),
        flush=True,
    )


def _age(value: dict[str, Any]) -> float:
    return time.time() - float(value["source_s"] or value["time_s"])


def _request(method: str, path: str, host: str, body: bytes = b"") -> bytes:
    head = f"{method} {path} HTTP/1.1\r\nHost: {host}\r\nContent-Length: {len(body)}\r\n\r\n"
    return head.encode() + body


async def _read_stream(host: str, port: int, query: str, seen: Any) -> None:
    reader, writer = await asyncio.open_connection(host, port, limit=1 << 22)
    writer.write(_request("GET", f"/api/v1/stream{query}", host))
    event = ""
    try:
        while line := (await reader.readline()).decode():
            if line.startswith("event: "):
                event = line[7:].strip()
            elif line.startswith("data: ") and event == "values":
                for value in json.loads(line[6:]):
                    seen(value)
    finally:
        writer.close()


async def _read_on(host: str, port: int, query: str, pieces: list[int]) -> None:
    """Read a stream without parsing it, so that this process keeps up with hundreds of streams."""
    reader, writer = await asyncio.open_connection(host, port, limit=1 << 18)
    writer.write(_request("GET", f"/api/v1/stream{query}", host))
    try:
        while data := await reader.read(1 << 18):
            pieces.append(len(data))
    finally:
        writer.close()


async def _scrape(host: str, port: int, end: float) -> None:
    while time.monotonic() < end:
        reader, writer = await asyncio.open_connection(host, port, limit=1 << 22)
        writer.write(_request("GET", "/metrics", host).replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
        await reader.read()
        writer.close()
        await asyncio.sleep(5)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
