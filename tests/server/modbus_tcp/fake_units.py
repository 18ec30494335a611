"""A fake plant for Modbus TCP doors, and the table of one door."""

from dataclasses import replace

from fake_plant import FakePlant

from drivecomm.protocol import PollGroup
from drivecomm.tomlfile import TomlTable


def table(**content):
    return TomlTable({"listen": "127.0.0.1:0", "units": {"pump": 1, "fan": 2}, **content}, "hall.toml", name="door 1")


class Plant(FakePlant):
    """Fake plant that polls two quantities of its drives, and records the commands refused by doors."""

    def __init__(self, **further):
        super().__init__(**further)
        self.refusals = []
        for name, state in self.states.items():
            polled = (PollGroup(parameters=("output_frequency", "output_current", "480")),)
            self.states[name] = replace(state, config=replace(state.config, poll=polled))

    def refuse(self, caller, command, why):
        self.refusals.append((caller, command, why))
