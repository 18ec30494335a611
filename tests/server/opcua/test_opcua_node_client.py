"""A third-party client: node-opcua browses, reads, subscribes, locks, commands and reads history."""

import asyncio
import json
import os
from pathlib import Path

import pytest
from served_opcua import PASSWORDS, until

pytestmark = pytest.mark.foreign

PROGRAM = Path(__file__).with_name("node_client.js")


async def asked(one, folder, *words):
    """Run the Node program; return its parsed output."""
    process = await asyncio.create_subprocess_exec(
        "node", str(PROGRAM), one.url, *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        env={**os.environ, "NODE_PATH": folder},
    )  # fmt: skip
    try:
        out, errors = await asyncio.wait_for(process.communicate(), 60)
    finally:
        if process.returncode is None:
            process.kill()
    assert process.returncode == 0, errors.decode()[-2000:]
    return json.loads(out.decode().strip().splitlines()[-1])


def test_node_opcua_browses_reads_commands_and_reads_history(door, node_opcua):
    async def test(one):
        told = await asked(one, node_opcua, "otto", PASSWORDS["otto"])
        assert {"pump", "fan"} <= set(told["drives"])
        assert {"Status", "Lock", "Monitoring", "Stop", "Start"} <= set(told["pump"])
        # On a busy machine the value may be stale by now.
        assert told["value"].pop("status") in ("Good", "UncertainLastUsableValue")
        assert told["value"] == {"number": True, "source": True}
        assert told["unit"] == 4740186
        assert told["unlocked"]["status"].startswith("BadRequiresLock")
        assert told["unlocked"]["outcome"] == "refused"
        assert told["locked"] == 0
        assert told["started"] == {"status": "Good", "outcome": "done"}
        assert told["ran"] is True
        assert told["stopped"] == {"status": "Good", "outcome": "done"}
        assert told["events"] >= 1
        assert told["history"] > 3
        assert told["written"] == "BadNotWritable"
        await until(lambda: not one.runs("pump"))

    door.run(test)


def test_node_opcua_is_refused_without_a_valid_password(door, node_opcua):
    async def test(one):
        assert "BadUserAccessDenied" in (await asked(one, node_opcua, "otto", "wrong"))["refused"]
        assert "refused" in await asked(one, node_opcua)

    door.run(test)
