"""Mosquitto in a separate process, which can be killed, suspended and restarted at the same port."""

import asyncio
import shutil

import pytest
from broker_process import BrokerProcess, running

PROGRAM = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")

needs_mosquitto = pytest.mark.skipif(
    PROGRAM is None, reason="mosquitto, the broker that it is tried with, is not installed (apt install mosquitto)"
)


def mosquitto(folder, *lines):
    """Run a broker; yield it. lines: further lines of its configuration."""
    folder.mkdir(exist_ok=True)
    broker, settings = BrokerProcess(folder / "mosquitto.log"), folder / "mosquitto.conf"
    said = ["allow_anonymous true"] if not any("allow_anonymous" in line for line in lines) else []
    # Debian's mosquitto drops root for a user who cannot read the folder of a test.
    settings.write_text("\n".join([f"listener {broker.port} 127.0.0.1", "user root", *said, *lines]) + "\n")
    broker.command = [PROGRAM, "-c", settings, "-v"]
    return running(broker)


async def until(condition, seconds=10.0):
    """Wait until a condition holds. Raises TimeoutError."""
    async with asyncio.timeout(seconds):
        while not condition():  # noqa: ASYNC110 - the condition has no event
            await asyncio.sleep(0.01)
