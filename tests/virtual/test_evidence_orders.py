"""Control orders for evidence about a running plant: telegrams, violations, counters, states."""

import json

import pytest

import drivecomm
from drivecomm.plant import Plant, PlantLine, script_of
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import VirtualPlant, answer_order


def order(plant, name, **fields):
    return json.loads(answer_order(plant, json.dumps({"order": name, **fields}).encode()))


def plant_of(*lines, **options):
    planned = Plant(
        lines=tuple(PlantLine(name=name) for name in lines),
        drives=tuple(DriveConfig(name=f"pump of {name}", protocol="vabus", address=1, line=name) for name in lines),
        script=script_of(options.pop("faults", ()), line=lines[0], drives=()),
    )
    plant = VirtualPlant(planned)
    plant.watch()
    return plant


def send_requests(plant, name, times=1):
    line = plant.line(name)
    port = line.port()
    port.configure(plant.drive(f"pump of {name}").settings)
    for _ in range(times):
        port.write(b"\x04A00481\x05")
        line.receive(line.time + 1, 19)
        line.advance(0.002)
    line.advance(1)


def test_telegrams_are_returned_from_the_requested_number_on():
    plant = plant_of("hall")
    send_requests(plant, "hall")
    first = order(plant, "telegrams")
    assert [each["source"] for each in first["telegrams"]] == ["master", "drive"]
    assert first["telegrams"][0]["telegram"] == "enquiry address=1 sys=0 dataset=0 parameter=481"
    assert (first["last"], first["more"], first["missing"]) == (2, False, 0)
    assert order(plant, "telegrams", since=2) == {"ok": True, "telegrams": [], "last": 2, "more": False, "missing": 0}
    send_requests(plant, "hall")
    assert [each["number"] for each in order(plant, "telegrams", since=2)["telegrams"]] == [3, 4]


def test_many_telegrams_come_in_several_answers_and_lost_ones_are_counted():
    plant = plant_of("hall")
    send_requests(plant, "hall", times=3000)
    since, numbers, missing = 0, [], 0
    while True:
        answer = order(plant, "telegrams", since=since)
        assert len(answer["telegrams"]) <= 500
        numbers += [each["number"] for each in answer["telegrams"]]
        missing += answer["missing"]
        since = answer["last"]
        if not answer["more"]:
            break
    assert numbers == list(range(1001, 6001))
    assert missing == 1000


def test_unfinished_telegram_is_returned_when_it_is_whole():
    plant = plant_of("hall")
    port = plant.line("hall").port()
    port.configure(plant.drive("pump of hall").settings)
    port.write(b"\x04A004")
    plant.line("hall").advance(0.01)
    assert order(plant, "telegrams")["telegrams"] == []
    port.write(b"81\x05")
    plant.line("hall").advance(1)
    told = order(plant, "telegrams")["telegrams"]
    assert [each["telegram"].split()[0] for each in told] == ["enquiry", "value"]


def test_order_must_name_one_of_several_lines():
    plant = plant_of("hall", "yard")
    send_requests(plant, "yard")
    assert "name one of hall, yard" in order(plant, "telegrams")["error"]
    assert order(plant, "telegrams", line="hall")["telegrams"] == []
    assert len(order(plant, "telegrams", line="yard")["telegrams"]) == 2
    assert order(plant, "violations", line="cellar")["ok"] is False
    assert order(plant, "telegrams", line="yard", since="0")["ok"] is False
    assert order(plant, "counters", line="yard")["ok"] is False


def test_violations_have_a_rule_and_a_source():
    plant = plant_of("hall")
    port = plant.line("hall").port()
    port.configure(plant.drive("pump of hall").settings)
    for _ in range(2):
        port.write(b"\x04A00481\x05")
        plant.line("hall").receive(plant.line("hall").time + 1, 19)
    plant.line("hall").advance(1)
    answer = order(plant, "violations")
    (found,) = answer["violations"]
    assert (found["rule"], found["source"], found["demanded"]) == ("turnaround", "Agile VABus manual p. 33", True)
    assert found["sentence"].startswith("pump of hall: the next request began 0 ms after the end of its reply")
    assert (answer["failures"], answer["notes"]) == ({"turnaround": 1}, {})


def test_counters_count_requests_replies_and_faults():
    plant = plant_of("hall", faults={"kind": "drop", "of": "reply to a read", "every": 3})
    send_requests(plant, "hall", times=4)
    answer = order(plant, "counters")
    assert answer["drives"] == [
        {"name": "pump of hall", "requests": 4, "kinds": {"enquiry": 4}, "replies": 4, "damaged": 0}
    ]
    (line,) = answer["lines"]
    assert line["transmissions"] == {"master": 4, "drive": 3}
    assert line["script"] == ["fault: drop of reply to a read, every 3; happened: 1 of 4"]


def test_state_contains_motor_and_line_settings():
    plant = plant_of("hall")
    with drivecomm.open_bus(plant.line("hall").port) as bus:
        drive = bus.drive("vabus", 1, model="agile")
        drive.set_reference(percent=50)
        drive.start()
        plant.line("hall").advance(20)
    (state,) = order(plant, "state")["drives"]
    assert (state["running"], state["at_reference"], state["target_hz"]) == (True, True, 25.0)
    assert (state["address"], state["settings"], state["powered"]) == (1, "19200 7E1", True)


@pytest.mark.parametrize("name", ["telegrams", "violations", "counters", "state"])
def test_query_order_changes_nothing(name):
    plant = plant_of("hall")
    send_requests(plant, "hall")
    before = order(plant, "show")
    assert order(plant, name) == order(plant, name)
    assert order(plant, "show") == before
