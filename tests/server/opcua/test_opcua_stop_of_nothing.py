"""The method that stops all drives, where there is none."""

import asyncio
from types import SimpleNamespace

from drivecomm.server.opcua.asking import Asking, asking
from drivecomm.server.opcua.methods import Methods


class NoDrives:
    async def stop_all(self, *_):
        return []


def test_that_there_is_no_drive_is_not_told_as_done():
    async def program():
        methods = object.__new__(Methods)
        methods._plant = NoDrives()
        asking.set(Asking(SimpleNamespace(caller=None, client="", over=False), 0.0))
        return await methods._stop_all()

    result = asyncio.run(program())
    assert result.StatusCode.name == "BadInvalidState"
    assert [each.Value for each in result.OutputArguments] == ["refused", "there is no drive that could be stopped"]
