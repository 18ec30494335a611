import shutil
import subprocess
from dataclasses import replace
from decimal import Decimal
from http import HTTPStatus

import pytest
from fake_plant import Client, value

from drivecomm.client import parsed
from drivecomm.errors import (
    CommandCancelledError,
    LeaseError,
    NoReplyError,
    NotAllowedError,
    NotAnsweringError,
    RefusedError,
    UsageError,
)
from drivecomm.protocol import LinkLossPolicy, Stop
from drivecomm.server import CommandAnswer, DriveDrift, NotComparable, RememberedFault, SetChange, StandingStop
from drivecomm.server.http import answers


@pytest.fixture
def otto(door):
    return Client(door, "ottootto")


def test_plant_endpoint_shows_lines_drives_and_the_caller(local):
    found = local.get("/api/v1/plant").content
    assert found["name"] == "hall 2"
    assert found["session"] == "blue-otter-17"
    assert found["drives"] == ["pump", "fan"]
    assert found["you"]["role"] == "commission"
    assert found["you"]["door"] == "local"
    assert found["lines"][0]["port"] == "/dev/ttyUSB0"
    assert found["alarms"] == 1


def test_drives_endpoint_shows_state_rights_and_values(local, plant):
    plant.change(value("pump", amount="10.00"))
    plant.states["fan"] = replace(
        plant.states["fan"],
        config=replace(plant.states["fan"].config, link_loss=LinkLossPolicy(policy="trip"), read_only_reason="no"),
        policies=("hold", "trip"),
        fault_log=(RememberedFault(place=1, address="15-30", value="14", text="earth fault", time_s=5.0),),
    )
    plant.states["pump"] = replace(
        plant.states["pump"], standing_stop=StandingStop(how=Stop.QUICK, who="otto (http)", since_s=5.5)
    )
    pump, fan = local.get("/api/v1/drives").content
    assert fan["standing_stop"] is None
    assert pump["standing_stop"] == {
        "how": "quick", "who": "otto (http)", "since_s": 5.5, "confirmed": False, "demanded": False,
        "text": "stop (quick) asked for by otto (http), not confirmed; retrying until the drive answers",
    }  # fmt: skip
    assert (pump["link_loss"], pump["fault_log"], pump["read_only_reason"]) == (None, [], "")
    assert fan["link_loss"] == {"policy": "trip", "watchdog_s": 5.0}
    assert fan["policies"] == ["hold", "trip"]
    assert fan["fault_log"] == [{"place": 1, "address": "15-30", "value": "14", "text": "earth fault", "time_s": 5.0}]
    assert fan["read_only_reason"] == "no"
    assert (pump["name"], pump["drive"], pump["line"], fan["name"]) == ("pump", "vabus:1", "main", "fan")
    assert pump["state"] == "running"
    assert pump["status"]["word"] == 0x0F07
    assert pump["may"] == ["read", "stop", "start"]
    assert str(pump["values"][0]["reading"]["value"]) == "10.00"
    assert pump == {**local.get("/api/v1/drives/pump").content, "age_s": pump["age_s"], "values": pump["values"]}


def test_drift_endpoint_shows_changes_since_the_baseline(local, plant):
    change = SetChange(
        address="420", name="acceleration", unit="s", approved=Decimal("5.00"), now=Decimal("7.50"), since_s=60.0
    )
    drift = DriveDrift(
        state="changed", changes=(change,), not_comparable=(NotComparable(address="481", reason="no reply"),), equal=70,
        approved_by="Anna", approved_s=50.0, compared_s=120.0,
    )  # fmt: skip
    plant.states["pump"] = replace(plant.states["pump"], drift=drift)
    pump, fan = local.get("/api/v1/drives").content
    assert pump["drift"] == {"state": "changed", "changed": 1, "since_s": 60, "compared_s": 120}
    assert fan["drift"] == {"state": "not compared", "changed": None, "since_s": None, "compared_s": None}
    found = local.get("/api/v1/drives/pump/drift").content
    assert found["changes"] == [
        {"address": "420", "name": "acceleration", "unit": "s", "approved": Decimal("5.00"), "now": Decimal("7.50"),
         "since_s": 60}
    ]  # fmt: skip
    assert str(found["changes"][0]["now"]) == "7.50"
    assert (found["drive"], found["changed"], found["since_s"], found["equal"]) == ("pump", 1, 60, 70)
    text = "1 parameter differs from the baseline since 1970-01-01 00:01 UTC: 420 acceleration: 5.00 -> 7.50 s"
    assert found["text"] == text
    assert found["not_comparable"] == [{"address": "481", "reason": "no reply"}]
    assert set(found) == set(answers.Drift.model_fields)
    answers.Drift.model_validate(found)
    assert local.get("/api/v1/drives/pumq/drift").status == 404


def test_drives_show_their_present_groups(local, plant):
    def change(**groups):
        drives = tuple(replace(each, groups=groups.get(each.name, ())) for each in plant.plant.drives)
        plant.plant = replace(plant.plant, drives=drives)

    def groups(query=""):
        return {each["name"]: each["groups"] for each in local.get(f"/api/v1/drives{query}").content}

    assert groups() == {"pump": [], "fan": []}
    change(pump=("wet", "hall 2"), fan=("hall 2",))
    assert groups() == {"pump": ["wet", "hall 2"], "fan": ["hall 2"]}
    assert local.get("/api/v1/drives/pump").content["groups"] == ["wet", "hall 2"]
    assert groups("?group=wet") == {"pump": ["wet", "hall 2"]}
    assert list(groups("?group=hall%202")) == ["pump", "fan"]


@pytest.mark.parametrize("group", ["dry", "pump", ""])
def test_drives_of_an_unknown_group_are_not_found(local, plant, group):
    plant.plant = replace(plant.plant, drives=tuple(replace(each, groups=("wet",)) for each in plant.plant.drives))
    found = local.get(f"/api/v1/drives?group={group}")
    assert found.status == 404
    assert f"there is no group {group!r} in this plant; " in found.content["error"]["text"]
    assert "t has wet" in found.content["error"]["text"]


def test_values_endpoint_shows_reading_and_age(local, plant):
    plant.change(value("pump", amount="10.00"), value("fan", quality="bad"))
    pump, fan = local.get("/api/v1/values").content
    assert pump["reading"]["value"] == Decimal("10.00")
    assert 0 <= pump["age_s"] < 5
    assert fan["reading"] is None
    assert fan["age_s"] is None


def test_unknown_drive_gives_404_with_a_suggestion(local):
    found = local.get("/api/v1/drives/pumq")
    assert found.status == 404
    assert found.content["error"]["kind"] == "UsageError"
    assert "did you mean 'pump'?" in found.content["error"]["text"]


def test_verb_is_sent_to_the_plant_and_its_result_returned(otto, door, plant):
    found = otto.post("/api/v1/drives/pump/read", id="1", arguments={"parameter": "481", "limit": 10.10})
    assert found.status == 200
    assert found.content["outcome"] == "done"
    assert found.content["result"]["unit"] == "Hz"
    caller, command = plant.commands[0]
    assert (caller.name, caller.door) == ("otto", f"http 127.0.0.1:{door.port}")
    assert (command.drive, command.verb, command.id) == ("pump", "read", "1")
    assert command.arguments == {"parameter": "481", "limit": Decimal("10.1")}


REFUSED = [
    (NotAllowedError("may not"), "refused", 403),
    (LeaseError("another has it"), "refused", 409),
    (CommandCancelledError("a stop came first"), "refused", 409),
    (UsageError("no such parameter"), "refused", 422),
    (RefusedError("481", 3, "read-only"), "failed", 502),
    (NotAnsweringError("does not answer"), "failed", 502),
    (NoReplyError("no reply"), "open", 504),
]


@pytest.mark.parametrize(("error", "outcome", "status"), REFUSED, ids=lambda each: str(getattr(each, "args", each)))
def test_failed_command_gives_a_matching_status(door, plant, error, outcome, status):
    plant.answers["otto", "1"] = CommandAnswer(id="1", outcome=outcome, error=error)
    found = Client(door, "ottootto").post("/api/v1/drives/pump/write", id="1")
    assert (found.status, found.content["status"]) == (status, status)
    assert found.headers["Content-Type"] == "application/problem+json"
    assert (found.content["id"], found.content["outcome"], found.content["result"]) == ("1", outcome, None)
    assert found.content["error"]["kind"] == type(error).__name__
    assert found.content["detail"] == found.content["error"]["text"]
    assert found.content["title"] == HTTPStatus(status).phrase


@pytest.mark.skipif(not shutil.which("curl"), reason="curl is not installed")
def test_curl_fails_for_a_refused_start(door, plant):
    def fails(token, verb):
        place = f"http://127.0.0.1:{door.port}/api/v1/drives/pump/{verb}"
        command = ["curl", "-sf", "-H", f"Authorization: Bearer {token}", "-d", f'{{"id": "{verb}"}}', place]
        return subprocess.run(command, capture_output=True, timeout=20, check=False).returncode

    assert fails("annaanna", "start") == 22
    assert fails("ottootto", "start") == 0
    assert plant.acted == ["start"]


def test_stream_sends_values_and_events(local, plant):
    with local.stream() as stream:
        assert stream.next().data["session"] == "blue-otter-17"
        assert {each["drive"] for each in stream.next("values").data} == {"pump", "fan"}
        plant.change(value("fan", amount="22.5"))
        assert [str(each["reading"]["value"]) for each in stream.next("values").data] == ["22.5"]
        plant.change(events=[plant.event(5)])
        told = stream.next("events")
        assert told.id == "5"
        assert told.data[0]["text"] == "it tripped"


def lines_of(answer):
    assert answer.headers["Content-Type"].startswith("application/x-ndjson")
    return [parsed(line) for line in answer.content.splitlines()]


@pytest.mark.parametrize(
    ("method", "what", "choices"),
    [
        ("POST", "scan", {"only": ["vabus"], "addresses": [1, 2]}),
        ("POST", "doctor", {"probes": 10}),
        ("GET", "trace", {}),
        ("GET", "statistics", {}),
    ],
)
def test_line_examination_endpoint_passes_its_choices_to_the_plant(local, method, what, choices):
    found = local.ask(method, f"/api/v1/lines/main/{what}", choices or None)
    assert lines_of(found) == [{"line": "main", "what": what, "choices": choices}]


def test_invalid_line_examination_is_refused(local):
    found = lines_of(local.post("/api/v1/lines/main/scan", only=["nonsense"]))
    assert found[0]["error"]["text"] == "there is no protocol 'nonsense'"
    assert local.post("/api/v1/lines/mein/scan").status == 404


def test_keep_command_is_sent_and_its_events_are_streamed(local, plant):
    body = {"id": "1", "lease": "", "policy": "ramp", "watchdog_s": 3, "percent": 50}
    assert local.post("/api/v1/drives/pump/keep", **body).content["outcome"] == "done"
    command = plant.commands[0][1]
    assert (command.verb, command.id) == ("keep", "1")
    assert command.arguments == {"policy": "ramp", "watchdog_s": 3, "percent": 50}
    found = lines_of(local.get("/api/v1/drives/pump/keep/events"))
    assert [each["done"] for each in found] == [False, False, True]


def test_local_door_commands_a_drive_outside_the_plant(local, plant):
    local.post("/api/v1/lines/main/drives/vabus:9/status")
    command = plant.commands[0][1]
    assert (command.drive, command.line, command.verb) == ("vabus:9", "main", "status")


def test_stop_endpoint_stops_all_drives_of_lines(local, plant):
    found = local.post("/api/v1/stop", how="coast", lines=["main"])
    assert [(each["drive"], each["outcome"], each["how"]) for each in found.content] == [
        ("pump", "done", "coast"), ("fan", "done", "coast"),
    ]  # fmt: skip
    assert plant.stops[0][1:] == ("coast", ("main",))
    assert local.post("/api/v1/stop", how="quickly").status == 422


def test_alarms_endpoint_lists_and_acknowledges(local):
    assert local.get("/api/v1/alarms").content[0]["id"] == "pump-fault"
    assert local.post("/api/v1/alarms/pump-fault/acknowledge").content["id"] == "pump-fault"
    assert local.post("/api/v1/alarms/other/acknowledge").status == 422


def test_history_endpoint_gives_points_and_events(local, plant):
    path = "/api/v1/history?drive=pump&name=output_frequency&from=10&to=20.5"
    assert local.get(path).content["points"] == [[10, Decimal("10.5"), "good"], [Decimal("20.5"), None, "bad"]]
    assert local.get("/api/v1/history/events?kind=fault&limit=5").content[0]["number"] == 7
    assert plant.history.asked[0] == ("pump", "output_frequency", 10, 20.5, 500)
    assert plant.history.asked[1][:2] == ("", "fault")
    plant.history = None
    assert "history = false" in local.get(path).content["error"]["text"]


def test_events_endpoint_gives_the_latest_up_to_its_limit(local, plant):
    plant.change(events=[plant.event(number) for number in range(1, 6)])
    assert [each["number"] for each in local.get("/api/v1/events?limit=2").content] == [4, 5]


def test_lease_is_acquired_renewed_and_released(local, plant):
    taken = local.post("/api/v1/drives/pump/lease", seconds=5).content
    assert taken["yours"] is True
    assert local.ask("PUT", "/api/v1/drives/pump/lease", {"key": taken["key"], "seconds": 9}).content["key"]
    assert local.get("/api/v1/leases").content[0]["drive"] == "pump"
    assert local.ask("DELETE", "/api/v1/drives/pump/lease", {"key": taken["key"]}).status == 200
    assert not plant.held
    assert local.post("/api/v1/drives/pump/lease", seconds=31).status == 422
