"""Commander at the HTTP door or the local socket; its orders and their outcomes are recorded in the book."""

import asyncio
import json
import time
from itertools import count

from orders import FOREVER, Start, Stop, note_answer
from server_bench import PATIENCE_S, TOKENS


class Http:
    """Requests of one user, each on a new connection; without a user, through the local socket."""

    def __init__(self, bench, book, user=""):
        self._bench, self._book, self._user, self._numbers = bench, book, user, count(1)
        self.door = "http" if user else "local"

    async def ask(self, method, path, content=None, *, leaves=False):
        """Return the answer, or None if none came. leaves: disconnect without waiting for it."""
        body = b"" if content is None else json.dumps(content).encode()
        head = f"{method} /api/v1/{path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
        if self._user:
            head += f"Authorization: Bearer {TOKENS[self._user]}\r\n"
        try:
            async with asyncio.timeout(PATIENCE_S):
                if self._user:
                    reader, writer = await asyncio.open_connection("127.0.0.1", self._bench.doors["http"].port)
                else:
                    reader, writer = await asyncio.open_unix_connection(self._bench.serving.socket)
                try:
                    writer.write(head.encode() + b"\r\n" + body)
                    if leaves:
                        await writer.drain()
                        return None
                    told = await reader.read()
                finally:
                    writer.close()
            return json.loads(told.partition(b"\r\n\r\n")[2])
        except (OSError, ValueError, TimeoutError):
            return None

    def _id(self):
        return f"{self.door} {self._user} {next(self._numbers)}"

    async def start(self, drive, *, lease_s=2.0, there_s=3.0, repeats=False, **arguments):
        """Start a motor under a lease and renew it for a while; lease_s = 0 starts it without a lease."""
        order = Start(time.monotonic(), self.door, drive, present_until=0.0)
        self._book.starts.append(order)
        content = {"id": self._id(), "arguments": {"percent": 60, **arguments}}
        key = ""
        if lease_s:
            taken = await self.ask("POST", f"drives/{drive}/lease", {"seconds": lease_s})
            key = (taken or {}).get("key", "")
            if not key:
                order.outcome, order.answered = "refused", time.monotonic()
                return
            content["lease"] = key
            order.present_until = time.monotonic() + lease_s
        await self._ordered(order, drive, "start", content)
        if repeats:
            await asyncio.sleep(there_s)
            # Repeat the answered order, which must not start anything again.
            await self.ask("POST", f"drives/{drive}/start", content)
        if not lease_s or self._is_hold(drive):
            order.present_until = FOREVER if self._is_hold(drive) else 0.0
            return
        until = time.monotonic() + there_s
        while time.monotonic() < until and not self._bench.over and order.outcome != "refused":
            await asyncio.sleep(lease_s / 3)
            asked = time.monotonic()
            renewed = await self.ask("PUT", f"drives/{drive}/lease", {"key": key, "seconds": lease_s})
            if "until_s" in (renewed or {}):
                order.present_until = asked + lease_s + (time.monotonic() - asked)
            elif renewed is not None:
                return

    async def start_here(self, drive):
        """Start a motor with the policy hold, as a program on the server's machine can."""
        order = Start(time.monotonic(), self.door, drive, local=True)
        self._book.starts.append(order)
        await self._ordered(order, drive, "keep", {"id": self._id(), "policy": "hold", "percent": 60})

    async def _ordered(self, order, drive, verb, content):
        answer = await self.ask("POST", f"drives/{drive}/{verb}", content)
        note_answer(order, answer)

    async def stop(self, drive="", *, how="ramp", leaves=False):
        order = Stop(time.monotonic(), self.door, drive, how=how)
        self._book.stops.append(order)
        if drive:
            content = {"id": self._id(), "arguments": {"how": how}}
            answer = await self.ask("POST", f"drives/{drive}/stop", content, leaves=leaves)
            note_answer(order, answer)
        else:
            answer = await self.ask("POST", "stop", {"how": how}, leaves=leaves)
            if isinstance(answer, list):
                order.answered, order.outcome = time.monotonic(), "open"

    async def do(self, drive, verb, **arguments):
        return await self.ask("POST", f"drives/{drive}/{verb}", {"id": self._id(), "arguments": arguments})

    def _is_hold(self, drive):
        return self._bench.policies[drive] == "hold"
