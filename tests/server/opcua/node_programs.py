"""Programs that use node-opcua, run beside a test."""

import asyncio
import json
import os
from contextlib import asynccontextmanager
from pathlib import Path

from served_opcua import PASSWORDS


@asynccontextmanager
async def node_program(folder, name, url, user, *words, told):
    """Run one of the Node programs of this folder as a client until the block ends; yield its process.

    told: called with each JSON object that the program prints, one a line.
    """
    process = await asyncio.create_subprocess_exec(
        "node", str(Path(__file__).with_name(name)), url, user, PASSWORDS[user], *words,
        stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        env={**os.environ, "NODE_PATH": folder},
    )  # fmt: skip

    async def read():
        while line := await process.stdout.readline():
            # The library also prints advice, which is not JSON.
            if line.startswith(b"{"):
                # asyncua omits the namespace of the standard.
                told(json.loads(line.replace(b'"ns=0;', b'"')))

    reading, errors = asyncio.create_task(read()), asyncio.create_task(process.stderr.read())
    try:
        yield process
        process.stdin.close()
        await asyncio.wait_for(process.wait(), 20)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
        await reading
        said = (await errors).decode()
    assert process.returncode == 0, said[-2000:]
