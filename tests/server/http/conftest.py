"""Doors that serve a fake plant."""

import pytest
from fake_plant import Client, FakeHistory, FakePlant, FakeUsers, served

from drivecomm.server.http import HttpDoor, LocalDoor
from drivecomm.tomlfile import TomlTable


@pytest.fixture
def plant():
    return FakePlant(users=FakeUsers(), history=FakeHistory())


@pytest.fixture
def local(plant, tmp_path):
    path = tmp_path / "hall.sock"
    with served(LocalDoor(path), plant):
        yield Client(path)


@pytest.fixture
def door(plant):
    made = HttpDoor(TomlTable({"kind": "http", "listen": "127.0.0.1:0"}, "hall.toml"))
    with served(made, plant):
        yield made
