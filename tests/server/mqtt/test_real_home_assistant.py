"""Real Home Assistant with the door's messages: its entities, their states, and its buttons."""

import json
import signal
import subprocess
import time
from contextlib import contextmanager

import pytest
from mosquitto import mosquitto, needs_mosquitto
from processes import server_of
from real_home_assistant import PYTHON, home_assistant, needs_home_assistant
from served_core import simulated

from drivecomm.models import quantities
from drivecomm.plant import read_plant
from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue
from drivecomm.server.mqtt.kinds import _CLASSES, _UNITS, kind_of

pytestmark = [needs_mosquitto, needs_home_assistant, pytest.mark.foreign, pytest.mark.soak]

HEAD = """\
format = 1
[server]
name = "hall"
status_period_s = 0.2
[[door]]
kind = "mqtt"
broker = "{broker}"
home_assistant = "homeassistant"
role = "operate"
{more}
[[line]]
name = "yard"
listen = "{yard}"
paced = false
[[line]]
name = "hall"
listen = "{hall}"
paced = false
"""
FAN = """\
[[drive]]
name = "fan"
title = "Extractor fan"
drive = "danfoss-fc:3"
line = "yard"
armed = true
options = { model = "fc302" }
poll = [{ parameters = ["output_frequency", "heat_sink_temperature", "energy", "running_hours", "15-43"] }]
link_loss = { policy = "hold" }
network = { mqtt = ["start", "reset", "reference"] }
"""
PUMP = """\
[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
options = { model = "agile" }
poll = [{ parameters = ["output_frequency"] }]
"""
PLACES = {"yard": "tcp:127.0.0.1:0", "hall": "tcp:127.0.0.1:0"}
FAN_SHOWS = {
    "sensor.drivecomm_hall_fan_status": ("State", "enum", None, None),
    "binary_sensor.drivecomm_hall_fan_problem": ("Fault", "problem", None, None),
    "sensor.drivecomm_hall_fan_output_frequency": ("Output frequency", "frequency", "Hz", "measurement"),
    "sensor.drivecomm_hall_fan_heat_sink_temperature": ("Heat sink temperature", "temperature", "°C", "measurement"),
    "sensor.drivecomm_hall_fan_energy": ("Energy", "energy", "kWh", "total_increasing"),
    "sensor.drivecomm_hall_fan_running_hours": ("Running hours", "duration", "h", "total_increasing"),
    "sensor.drivecomm_hall_fan_15_43": ("15-43 software version", None, None, None),
    "button.drivecomm_hall_fan_command_stop": ("Stop", None, None, None),
    "button.drivecomm_hall_fan_command_start": ("Start", None, None, None),
    "button.drivecomm_hall_fan_command_reset": ("Reset fault", None, None, None),
    "number.drivecomm_hall_fan_command_reference": ("Reference", None, "%", None),
    "event.drivecomm_hall_fan_command_answer": ("Answer", None, None, None),
}
PUMP_SHOWS = {
    "sensor.drivecomm_hall_pump_status",
    "binary_sensor.drivecomm_hall_pump_problem",
    "sensor.drivecomm_hall_pump_output_frequency",
    "button.drivecomm_hall_pump_command_stop",
    "event.drivecomm_hall_pump_command_answer",
}
FREQUENCY, STATE = "sensor.drivecomm_hall_fan_output_frequency", "sensor.drivecomm_hall_fan_status"
FAULT = "binary_sensor.drivecomm_hall_fan_problem"
REFERENCE, ANSWER = "number.drivecomm_hall_fan_command_reference", "event.drivecomm_hall_fan_command_answer"
START, STOP = "button.drivecomm_hall_fan_command_start", "button.drivecomm_hall_fan_command_stop"


@contextmanager
def served_there(folder, more=""):
    """Serve two drives on the broker of Home Assistant.

    Yields the server, Home Assistant, and the head of the plant file. more: additional keys of the door.
    """
    with mosquitto(folder / "broker") as broker:
        file = folder / "plant.toml"
        file.write_text(HEAD.format(broker=broker.url, more=more, **PLACES) + FAN + PUMP)
        with simulated(read_plant(file)) as (server, control):
            places = {name: f"tcp:{address.partition('://')[2]}" for name, address in server.addresses.items()}
            head = HEAD.format(broker=broker.url, more=more, **places)
            file.write_text(head + FAN + PUMP)
            with home_assistant(folder / "home assistant") as home, server_of(folder, control) as served:
                home.begin(broker)
                yield served, home, head


def of(home, drive):
    return {name: each["state"] for name, each in home.states().items() if f"_hall_{drive}_" in name}


def is_there(home, drive):
    found = of(home, drive)
    return bool(found) and "unavailable" not in found.values()


def is_gone(home, drive):
    return set(of(home, drive).values()) == {"unavailable"}


def answers(home):
    attributes = home.states()[ANSWER]["attributes"]
    return attributes.get("event_type"), attributes.get("verb"), attributes.get("error")


def test_home_assistant_follows_drives_over_their_whole_life(tmp_path):
    with served_there(tmp_path) as (served, home, head):
        shows_what_there_is(home)
        commands(served, home)
        shows_who_is_there(served, home)
        keeps_up_with_the_plant_file(served, home, head)


def test_home_assistant_reads_the_values_of_a_drive_from_one_message(tmp_path):
    with served_there(tmp_path, 'messages = "drives"') as (served, home, head):
        shows_what_there_is(home)
        commands(served, home)
        served.plant.write_text(head + FAN.replace('"energy", ', "") + PUMP)
        served.process.send_signal(signal.SIGHUP)
        home.until(lambda: "sensor.drivecomm_hall_fan_energy" not in home.states())
        home.until(lambda: is_there(home, "fan"))
        home.no_complaints()


TAKES = """\
import json, sys
from homeassistant.components.mqtt.sensor import DISCOVERY_SCHEMA
for each in json.load(sys.stdin):
    DISCOVERY_SCHEMA(each)
    print(each["unit_of_measurement"])
"""


def test_home_assistant_accepts_every_unit_with_its_class():
    units = {each.unit for each in quantities().values()} | {*_CLASSES, *_UNITS, "reference unit", "V or mA", "Ohm"}
    sensors = []
    for unit in sorted(units - {""}):
        reading = Reading(parameter="1", value=1, raw=1, unit=unit)
        value = CurrentValue(time_s=1.0, drive="fan", name="1", reading=reading, quality="good")
        sensors.append({"state_topic": "x", **kind_of(value, "")})
        # Home Assistant accepts templates only in its event loop.
        del sensors[-1]["value_template"]
    done = subprocess.run(
        [PYTHON, "-c", TAKES], input=json.dumps(sensors), capture_output=True, text=True, timeout=120, check=False
    )
    assert len(done.stdout.splitlines()) == len(sensors), done.stdout + done.stderr


def shows_what_there_is(home):
    home.until(lambda: {*FAN_SHOWS, *PUMP_SHOWS} <= home.states().keys())
    home.until(lambda: is_there(home, "fan") and is_there(home, "pump"))
    home.until(lambda: home.state(FREQUENCY) == "0.0")
    states = home.states()
    assert states.keys() == {*FAN_SHOWS, *PUMP_SHOWS}
    for name, (title, device_class, unit, state_class) in FAN_SHOWS.items():
        attributes = states[name]["attributes"]
        assert attributes["friendly_name"] == f"Extractor fan {title}"
        assert attributes.get("device_class") == device_class
        assert attributes.get("unit_of_measurement") == unit
        assert attributes.get("state_class") == state_class
    assert states[STATE]["attributes"]["options"] == ["not_ready", "ready", "running", "stopping", "fault"]
    assert (states[STATE]["state"], states[FAULT]["state"]) == ("ready", "off")
    assert states["sensor.drivecomm_hall_fan_15_43"]["state"] == "5.11"
    assert home.device(STATE) == ["Extractor fan", "fc302", "None", "hall"]
    home.no_complaints()


def commands(served, home):
    assert home.state(REFERENCE) == "unknown"
    home.call("number.set_value", REFERENCE, value=40)
    home.until(lambda: home.state(REFERENCE) == "40")
    assert answers(home) == ("done", "set_reference", None)
    home.call("button.press", START)
    home.until(lambda: answers(home)[1] == "start")
    assert answers(home) == ("done", "start", None)
    served.until(lambda: served.runs("fan"))
    home.until(lambda: home.state(STATE) == "running")
    home.until(lambda: float(home.state(FREQUENCY)) > 0)
    home.call("button.press", STOP)
    served.until(lambda: not served.runs("fan"))
    home.until(lambda: home.state(STATE) == "ready")
    # A refused command is shown with its error, and a refused reference is not shown as set.
    served.control.order("trip", drive="fan", code=4)
    home.until(lambda: (home.state(STATE), home.state(FAULT)) == ("fault", "on"))
    home.call("button.press", START)
    home.until(lambda: answers(home)[0] != "done")
    assert answers(home)[2], answers(home)
    assert not served.runs("fan")
    home.call("button.press", "button.drivecomm_hall_fan_command_reset")
    home.until(lambda: (home.state(STATE), home.state(FAULT)) == ("ready", "off"))
    home.no_complaints()


def shows_who_is_there(served, home):
    served.control.order("power", drive="fan", state="off")
    home.until(lambda: home.state(FREQUENCY) == "unavailable")
    # The stop button stays, since a silent drive may still receive a stop.
    there = {name for name, state in of(home, "fan").items() if state != "unavailable"}
    assert there == {STOP, ANSWER}
    home.call("button.press", STOP)
    home.until(lambda: answers(home)[:2] == ("open", "stop"))
    assert is_there(home, "pump")
    served.control.order("power", drive="fan", state="on")
    home.until(lambda: is_there(home, "fan"), 60)
    # A suspended server publishes nothing, and its values expire before the broker notices the loss.
    served.process.send_signal(signal.SIGSTOP)
    began = time.monotonic()
    home.until(lambda: home.state(FREQUENCY) == "unavailable", 40)
    assert time.monotonic() - began < 15
    served.process.send_signal(signal.SIGCONT)
    home.until(lambda: is_there(home, "fan") and is_there(home, "pump"), 60)
    served.end(signal.SIGKILL)
    home.until(lambda: is_gone(home, "fan") and is_gone(home, "pump"), 5)
    served.start()
    home.until(lambda: is_there(home, "fan") and is_there(home, "pump"), 60)
    home.no_complaints()
    # A button is valid for the present connection; it is refused until the new session has arrived.
    home.until(lambda: sets(home, 30))
    before = set(home.states())
    home.end()
    home.start()
    home.until(lambda: set(home.states()) == before and is_there(home, "fan") and is_there(home, "pump"), 60)
    home.until(lambda: home.state(FREQUENCY) == "0.0")
    home.no_complaints(seen=True)


def sets(home, percent):
    home.call("number.set_value", REFERENCE, value=percent)
    time.sleep(0.5)
    return home.state(REFERENCE) == f"{percent}"


def keeps_up_with_the_plant_file(served, home, head):
    served.end(signal.SIGKILL)
    # The plant file loses the pump, a quantity, and the permission to start.
    served.plant.write_text(head + FAN.replace('"start", ', "").replace('"energy", ', ""))
    served.start()
    home.until(lambda: is_there(home, "fan"))
    home.until(lambda: not of(home, "pump"))
    gone = {START, "sensor.drivecomm_hall_fan_energy"}
    home.until(lambda: home.states().keys() == FAN_SHOWS.keys() - gone)
    # A reload during operation leaves only the permission to stop.
    served.plant.write_text(head + FAN[: FAN.index("network")] + PUMP)
    served.process.send_signal(signal.SIGHUP)
    home.until(lambda: home.states().keys() >= PUMP_SHOWS and REFERENCE not in home.states())
    home.until(lambda: is_there(home, "fan") and is_there(home, "pump"))
    assert {name.split(".")[1] for name in of(home, "fan") if name.startswith("button")} == {STOP.split(".")[1]}
    served.plant.write_text(head + PUMP)
    served.process.send_signal(signal.SIGHUP)
    home.until(lambda: home.states().keys() == PUMP_SHOWS)
    home.no_complaints()
