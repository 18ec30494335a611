from decimal import Decimal

import pytest
from fake_plant import Client, value


@pytest.fixture
def otto(door):
    return Client(door, "ottootto")


def test_the_plant(local):
    found = local.get("/api/v1/plant").content
    assert found["name"] == "hall 2"
    assert found["session"] == "blue-otter-17"
    assert found["drives"] == ["pump", "fan"]
    assert found["you"]["role"] == "commission"
    assert found["you"]["door"] == "local"
    assert found["lines"][0]["port"] == "/dev/ttyUSB0"
    assert found["alarms"] == 1


def test_drives(local, plant):
    plant.change(value("pump", amount="10.00"))
    pump, fan = local.get("/api/v1/drives").content
    assert (pump["name"], pump["drive"], pump["line"], fan["name"]) == ("pump", "vabus:1", "main", "fan")
    assert pump["state"] == "running"
    assert pump["status"]["word"] == 0x0F07
    assert pump["may"] == ["read", "stop", "start"]
    assert str(pump["values"][0]["reading"]["value"]) == "10.00"
    assert pump == {**local.get("/api/v1/drives/pump").content, "age_s": pump["age_s"], "values": pump["values"]}


def test_values(local, plant):
    plant.change(value("pump", amount="10.00"), value("fan", quality="bad"))
    pump, fan = local.get("/api/v1/values").content
    assert pump["reading"]["value"] == Decimal("10.00")
    assert 0 <= pump["age_s"] < 5
    assert fan["reading"] is None
    assert fan["age_s"] is None


def test_a_drive_that_is_not_there(local):
    found = local.get("/api/v1/drives/pumq")
    assert found.status == 404
    assert found.content["error"]["kind"] == "UsageError"
    assert "did you mean 'pump'?" in found.content["error"]["text"]


def test_a_verb(otto, plant):
    found = otto.post("/api/v1/drives/pump/read", id="1", arguments={"parameter": "481", "limit": 10.10})
    assert found.status == 200
    assert found.content["outcome"] == "done"
    assert found.content["result"]["unit"] == "Hz"
    caller, command = plant.commands[0]
    assert (caller.name, caller.door) == ("otto", "http 127.0.0.1:0")
    assert (command.drive, command.verb, command.id) == ("pump", "read", "1")
    assert command.arguments == {"parameter": "481", "limit": Decimal("10.1")}


def test_a_refused_command_is_an_answer(door):
    found = Client(door, "annaanna").post("/api/v1/drives/pump/start", id="1")
    assert found.status == 200
    assert found.content["outcome"] == "refused"
    assert found.content["error"]["kind"] == "NotAllowedError"


def test_the_stream(local, plant):
    with local.stream() as stream:
        assert stream.next().data["session"] == "blue-otter-17"
        assert {each["drive"] for each in stream.next("values").data} == {"pump", "fan"}
        plant.change(value("fan", amount="22.5"))
        assert [str(each["reading"]["value"]) for each in stream.next("values").data] == ["22.5"]
        plant.change(events=[plant.event(5)])
        told = stream.next("events")
        assert told.id == "5"
        assert told.data[0]["text"] == "it tripped"
