"""One plant with an OPC UA door for all tests of a module: making its address space takes more than a second."""

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
    """Each login would take a tenth of a second of the processor; what guesses cost is asked elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(credentials, "_COST", (2, 1, 1))
        yield


class Shared:
    """A door, and the loop in which its plant runs."""

    def __init__(self, runner, one):
        self._runner, self._one = runner, one

    def run(self, test):
        """Run a coroutine function of a test with the door; nobody has a lock before it, and no motor turns."""
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
    """A plant with values that tests set, 480 and 518 of the fan; yields what runs a test with its door."""
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
    """The folder with node-opcua: in DRIVECOMM_NODE_MODULES, in NODE_PATH, or where npm installs for all."""
    if shutil.which("node"):
        said = [os.environ.get("DRIVECOMM_NODE_MODULES", ""), *os.environ.get("NODE_PATH", "").split(os.pathsep)]
        if shutil.which("npm"):
            found = subprocess.run(["npm", "root", "-g"], capture_output=True, text=True, check=False, timeout=60)
            said.append(found.stdout.strip())
        for each in said:
            if each and (Path(each) / "node-opcua").is_dir():
                return each
    pytest.skip("node-opcua is not installed; name its folder in DRIVECOMM_NODE_MODULES")
