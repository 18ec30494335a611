"""One plant with an OPC UA door, shared by the tests of a module, since its address space takes a second to build."""

import asyncio
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from served_opcua import PLANT, opened

from drivecomm.server import credentials


@pytest.fixture(autouse=True, scope="module")
def _passwords_that_cost_little():
    """Make password hashes cheap, since each login would take 0.1 s; other tests cover their cost."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(credentials, "_COST", (2, 1, 1))
        yield


class Shared:
    """A door, and the event loop of its plant."""

    def __init__(self, runner, one):
        self._runner, self._one = runner, one

    def run(self, test):
        """Run a coroutine function of a test with the door; before it, locks are released and motors stopped."""
        self._runner.run(self._run(test))

    async def _run(self, test):
        one = self._one
        one.core.audit.__init__()
        await test(one)
        for lease in one.plant.leases():
            await one.plant.end_lease(lease.holder, lease.drive, lease.key)
        for drive in ("pump", "fan"):
            await one.core.lines[one.core.plant.drive(drive).line].drive(drive).stop()


@pytest.fixture(scope="module")
def door(tmp_path_factory):
    with asyncio.Runner() as runner:
        context = opened(tmp_path_factory.mktemp("plant"), history=True)
        one = runner.run(context.__aenter__())
        try:
            yield Shared(runner, one)
        finally:
            runner.run(context.__aexit__(None, None, None))


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    """Yield a function that runs a test with the door of a plant whose values 480 and 518 of the fan the test sets."""
    polled = PLANT.replace('"output_current", "maximum_frequency"], period_s = 0.05', '"480", "518"], period_s = 0.2')
    with asyncio.Runner() as runner:
        context = opened(tmp_path_factory.mktemp("plant"), polled, history=True)
        one = runner.run(context.__aenter__())
        try:
            yield lambda test: runner.run(test(one))
        finally:
            runner.run(context.__aexit__(None, None, None))


@pytest.fixture(scope="session")
def node_opcua():
    """Return the folder with node-opcua: DRIVECOMM_NODE_MODULES, NODE_PATH, or npm's global folder."""
    if shutil.which("node"):
        said = [os.environ.get("DRIVECOMM_NODE_MODULES", ""), *os.environ.get("NODE_PATH", "").split(os.pathsep)]
        if shutil.which("npm"):
            found = subprocess.run(["npm", "root", "-g"], capture_output=True, text=True, check=False, timeout=60)
            said.append(found.stdout.strip())
        for each in said:
            if each and (Path(each) / "node-opcua").is_dir():
                return each
    pytest.skip("node-opcua is not installed; name its folder in DRIVECOMM_NODE_MODULES")
