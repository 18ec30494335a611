"""Tags of the plant file as display names; the exported address of a value is its node id."""

import asyncio

import pytest
from served_core import awaited
from served_opcua import PLANT, opened

from drivecomm.plant import read_plant

TAGGED = PLANT.replace(
    'network = { opcua = ["start", "reference", "reset"], write = ["3-41"] }\n',
    'tags = { output_frequency = { name = "P101.SPEED" }, "3-41" = { group = "ramps" } }\n',
)


@pytest.mark.soak
@awaited
async def test_tag_is_the_display_name_at_the_exported_address(tmp_path):
    async with opened(tmp_path, TAGGED, users=False, anonymous="view") as served, served.client() as client:
        drive = served.core.plant.drive("pump")

        async def names(value):
            node = client.get_node(served.door.address_of("hall 2", drive, value))
            return (await node.read_display_name()).Text, (await node.read_browse_name()).Name

        assert await names("output_frequency") == ("P101.SPEED", "ConverterOutputFrequency")
        assert await names("3-41") == ("3-41", "3-41")
        assert await names("status") == ("State", "State")
        node = client.get_node(served.door.address_of("hall 2", drive, "output_frequency"))
        assert isinstance(await node.read_value(), float)
        for text, name in ((TAGGED.replace("P101", "P102"), "P102.SPEED"), (PLANT, "ConverterOutputFrequency")):
            (tmp_path / "plant.toml").write_text(text)
            await served.core.changed(read_plant(tmp_path / "plant.toml"))
            async with asyncio.timeout(20):
                while (await names("output_frequency"))[0] != name:  # noqa: ASYNC110 - reads over the network
                    await asyncio.sleep(0.05)
