"""Commander at the OPC UA door that locks a drive, starts it, stays for a while and then disconnects abruptly."""

import asyncio
import time
from contextlib import suppress

from asyncua import Client, ua
from orders import FOREVER, Start, Stop
from server_bench import PATIENCE_S, TOKENS


class OpcuaUser:
    def __init__(self, bench, book):
        self._bench, self._book = bench, book

    async def start(self, drive, there_s):
        order = Start(time.monotonic(), "opcua", drive)
        self._book.starts.append(order)
        hold = self._bench.policies[drive] == "hold"
        client = await connected(self._bench)
        if client is None:
            order.outcome, order.answered = "refused", time.monotonic()
            return
        try:
            async with asyncio.timeout(PATIENCE_S):
                await call(client, "InitLock", "a script", on=f"drives/{drive}/Lock")
                answer = await call(client, "Start", on=f"drives/{drive}")
            order.outcome = answer[0] if answer else "refused"
            order.answered = time.monotonic()
            await asyncio.sleep(there_s)
        except (Exception, asyncio.CancelledError):  # noqa: BLE001 - the order may have been carried out
            order.outcome = order.outcome or "open"
        finally:
            if not hold:
                order.present_until = time.monotonic()
            transport = client.uaclient.protocol.transport if client.uaclient.protocol else None
            if transport is not None:
                transport.abort()
            with suppress(Exception):
                await asyncio.wait_for(client.disconnect(), 1.0)
        if hold:
            order.present_until = FOREVER

    async def stop(self, drive):
        order = Stop(time.monotonic(), "opcua", drive)
        self._book.stops.append(order)
        client = await connected(self._bench)
        if client is None:
            return
        with suppress(Exception):
            async with asyncio.timeout(PATIENCE_S):
                answer = await call(client, "Stop", on=f"drives/{drive}")
            if answer:
                order.answered, order.outcome = time.monotonic(), answer[0]
        with suppress(Exception):
            await asyncio.wait_for(client.disconnect(), 5.0)

    async def close(self):
        """Do nothing: no connection stays open."""


async def connected(bench):
    """Return a client of a user who may operate, or None if the door refuses the connection."""
    client = Client(f"opc.tcp://127.0.0.1:{bench.doors['opcua'].port}/", timeout=10)
    client.set_user("otto")
    client.set_password(TOKENS["otto"])
    with suppress(Exception):
        async with asyncio.timeout(PATIENCE_S):
            await client.connect()
        return client
    return None


async def call(client, method, *arguments, on):
    """Call a method of a node, and return its output values."""
    request = ua.CallMethodRequest(
        ObjectId=ua.NodeId(on, 2),
        MethodId=ua.NodeId(f"methods/{method}", 2),
        InputArguments=[ua.Variant(each) for each in arguments],
    )
    (result,) = await client.uaclient.call([request])
    return [each.Value for each in result.OutputArguments or []]
