"""Well-known Modbus RTU libraries reading one register on the same line and the same emulator."""

from __future__ import annotations

import asyncio
import time
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Any

import minimalmodbus
from counting import WARM_UP, count_awaited, in_threads, in_turn
from pymodbus.client import AsyncModbusSerialClient, ModbusSerialClient

if TYPE_CHECKING:
    from counting import Counts, Job


def _minimalmodbus(opened: ExitStack, path: str, baudrate: int) -> Any:
    instrument = minimalmodbus.Instrument(path, 1)
    opened.callback(instrument.serial.close)
    instrument.serial.baudrate = baudrate
    instrument.serial.timeout = 0.5
    return lambda: instrument.read_register(0)


def _pymodbus(opened: ExitStack, path: str, baudrate: int) -> Any:
    client = ModbusSerialClient(path, baudrate=baudrate, timeout=0.5)
    client.connect()
    opened.callback(client.close)
    return lambda: _sound(client.read_holding_registers(0, count=1, device_id=1))


def _sound(reply: Any) -> None:
    if reply.isError():
        raise RuntimeError(f"a peer met {reply}")


def minimal(job: Job) -> tuple[Counts, float]:
    """Read with minimalmodbus, one thread per line."""
    return _blocking(_minimalmodbus, job)


def blocking(job: Job) -> tuple[Counts, float]:
    """Read with pymodbus' blocking client, one thread per line."""
    return _blocking(_pymodbus, job)


def _blocking(maker: Any, job: Job) -> tuple[Counts, float]:
    with ExitStack() as opened:
        if len(job["paths"]) == 1:
            return in_turn(maker(opened, job["paths"][0], job["baudrate"]), job["seconds"])
        makers = [partial(maker, opened, path, job["baudrate"]) for path in job["paths"]]
        return in_threads(makers, job["seconds"])


def awaited(job: Job) -> tuple[Counts, float]:
    """Read with pymodbus' asyncio client, one task per line."""
    return asyncio.run(_awaited(job))


async def _awaited(job: Job) -> tuple[Counts, float]:
    clients = [AsyncModbusSerialClient(path, baudrate=job["baudrate"], timeout=0.5) for path in job["paths"]]
    for client in clients:
        await client.connect()
    reads = [_reader(client) for client in clients]
    for _ in range(WARM_UP):
        await asyncio.gather(*(read() for read in reads))
    began = time.process_time()
    counts = await asyncio.gather(*(count_awaited(read, job["seconds"]) for read in reads))
    spent = time.process_time() - began
    for client in clients:
        client.close()
    return list(counts), spent


def _reader(client: Any) -> Any:
    async def read() -> None:
        _sound(await client.read_holding_registers(0, count=1, device_id=1))

    return read


WAYS = {"minimalmodbus": minimal, "pymodbus": blocking, "pymodbus asyncio": awaited}
