"""Clients of a server, in a process of their own: streams that are read or never read, a page, a scraper, stops.

python server_clients.py HOST:PORT SOCKET, and a line of JSON: seconds, readers, idle, drive (stopped now and then).
Prints a line of JSON with what was seen: how old values were when the first reader had them, and how long stops took.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from statistics import median
from typing import Any

_STOPS = 20


async def main(place: str, path: str) -> None:
    """Be the clients."""
    asked = json.loads(sys.stdin.readline())
    host, _, port = place.rpartition(":")
    ages: list[float] = []
    others: list[int] = []
    end = time.monotonic() + asked["seconds"]
    tasks = [
        asyncio.create_task(_read_stream(host, int(port), "", lambda value: ages.append(_age(value)))),
        asyncio.create_task(_scrape(host, int(port), end)),
        *(
            asyncio.create_task(_read_stream(host, int(port), "?every=1", lambda _: others.append(1)))
            for _ in range(asked["readers"])
        ),
    ]
    idle = [await asyncio.open_connection(host, int(port)) for _ in range(asked["idle"])]
    for _, writer in idle:
        writer.write(_request("GET", "/api/v1/stream", host))
    await asyncio.sleep(2)
    ages.clear()
    print("ready", flush=True)
    stops = [await _stop(path, asked["drive"]) for _ in range(_STOPS) if not await asyncio.sleep(asked["seconds"] / 25)]
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
                "slow_values": len(others),
                "stops_s": sorted(stops),
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


async def _scrape(host: str, port: int, end: float) -> None:
    while time.monotonic() < end:
        reader, writer = await asyncio.open_connection(host, port, limit=1 << 22)
        writer.write(_request("GET", "/metrics", host).replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
        await reader.read()
        writer.close()
        await asyncio.sleep(5)


async def _stop(path: str, drive: str) -> float:
    """Stop a drive by the local door, and return how long that took."""
    began = time.perf_counter()
    reader, writer = await asyncio.open_unix_connection(path)
    writer.write(_request("POST", f"/api/v1/drives/{drive}/stop", "local", b'{"id": ""}'))
    answer = await reader.readuntil(b"}")
    writer.close()
    if b" 200 " not in answer.splitlines()[0]:
        raise RuntimeError(answer.decode())
    return time.perf_counter() - began


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], sys.argv[2]))
