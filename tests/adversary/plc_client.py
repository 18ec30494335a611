"""PLC at the Modbus TCP door; its orders and their outcomes are recorded in the book."""

import asyncio
import struct
import time

from orders import FOREVER, Start, Stop
from server_bench import PATIENCE_S, UNITS

from drivecomm.server import cancel_and_wait

_STOP, _AGAIN_S = 1000, 0.2


class Plc:
    """A PLC that writes its image of one drive in each cycle while it is connected."""

    def __init__(self, bench, book, drive):
        self._bench, self._book, self._drive = bench, book, drive
        self.stopping = self._heartbeat = self._sequence = self._command = 0
        self._task = self._reader = self._writer = self._standing = None
        self._start, self._number = None, 0

    def connect(self):
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._cycles())

    async def disconnect(self):
        if self._task is not None:
            await cancel_and_wait(self._task)
        self._gone()

    def _gone(self):
        now = time.monotonic()
        if self._start is not None and self._bench.policies[self._drive] != "hold":
            self._start.present_until = min(self._start.present_until, now)
        if self._standing is not None:
            self._standing.stands_until = min(self._standing.stands_until, now)
        self._start = self._standing = None

    def start(self):
        self._sequence, self._command = self._sequence + 1, 1
        self._start = Start(time.monotonic(), "modbus-tcp", self._drive)
        self._book.starts.append(self._start)
        self.connect()

    def stop(self, standing):
        """Set or clear the stop of the image."""
        self.stopping = int(standing)
        if not standing and self._standing is not None:
            self._standing.stands_until = time.monotonic()
            self._standing = None
        if standing:
            self.connect()

    async def _cycles(self):
        self._standing, writer = None, None
        try:
            reader, writer = await asyncio.open_connection("127.0.0.1", self._bench.doors["modbus-tcp"].port)
            while True:
                if self._command:
                    # A heartbeat acquires a lease, which a mere stop does not need.
                    self._heartbeat = self._heartbeat % 65535 + 1
                wrote = self.stopping
                words = (wrote, self._heartbeat, self._sequence, self._command, 1, 0, 0x4248, 0)
                self._number = (self._number + 1) % 65536
                pdu = struct.pack(">BHHB8H", 16, _STOP, 8, 16, *words)
                writer.write(struct.pack(">HHHB", self._number, 0, len(pdu) + 1, UNITS[self._drive]) + pdu)
                head = await asyncio.wait_for(reader.readexactly(7), PATIENCE_S)
                answer = await reader.readexactly(struct.unpack(">H", head[4:6])[0] - 1)
                if not answer[0] & 0x80 and wrote and self._standing is None:
                    self._standing = Stop(
                        time.monotonic(), "modbus-tcp", self._drive, time.monotonic(), "open", FOREVER
                    )
                    self._book.stops.append(self._standing)
                await asyncio.sleep(_AGAIN_S)
        except (OSError, EOFError, TimeoutError):
            pass
        finally:
            self._gone()
            if writer is not None:
                writer.close()
