"""Third-party masters against a server process: mbpoll, and the client of pymodbus."""

import json
import math
import re
import shutil
import socket
import struct
import subprocess
import time
from contextlib import contextmanager
from importlib.metadata import entry_points

import pytest
from processes import QUICK, serving
from pymodbus.client import ModbusTcpClient
from raw_master import float_words

pytestmark = [pytest.mark.foreign, pytest.mark.soak]

DOOR = """\
[[door]]
kind = "modbus-tcp"
listen = "127.0.0.1:{port}"
units = {{ fan = 3, pump = 247 }}
registers = {{ fan = {{ output_frequency = 200 }} }}
commands_from = ["127.0.0.1"]
lease_s = 2
"""
NETWORK = 'link_loss = { policy = "ramp", watchdog_s = 1 }\nnetwork = { modbus-tcp = ["start", "reference"] }'


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return taken.getsockname()[1]


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    if not any(each.name == "modbus-tcp" for each in entry_points(group="drivecomm.doors")):
        pytest.skip("the installed drivecomm is older than its Modbus TCP door; install it again")
    folder, port = tmp_path_factory.mktemp("plant"), free_port()
    with serving(folder, head=QUICK + DOOR.format(port=port), start=False) as one:
        text = one.plant.read_text().replace('link_loss = { policy = "ramp", watchdog_s = 1 }', NETWORK)
        # The period is longer than the poll delay of a busy machine, so that values do not expire.
        one.plant.write_text(text.replace("period_s = 0.1", "period_s = 0.5").replace(QUICK, ""))
        one.start()
        one.until(lambda: one.drive("fan")["reachability"] == "answers")
        one.port = port
        yield one


@pytest.fixture
def mbpoll(served):
    """Return a function that runs mbpoll once and returns the words that it read, or its error message."""
    program = shutil.which("mbpoll")
    if program is None:
        pytest.skip("mbpoll, a third-party master, is not installed")

    def ask(*options, write=()):
        command = [program, "-p", str(served.port), *options, *([] if write else ["-1"]), "127.0.0.1", *map(str, write)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
        found = re.findall(r"^\[(\d+)\]:\s+(\S+)", done.stdout, re.MULTILINE)
        return {int(place): word for place, word in found} if found else done.stdout + done.stderr

    return ask


@pytest.fixture
def client(served):
    with ModbusTcpClient("127.0.0.1", port=served.port, timeout=10) as found:
        assert found.connect()
        yield found


@contextmanager
def kept_fan(served):
    """Keep the fan running at half of its reference range during the block, commanded by another caller."""
    key = served.keep("fan")
    try:
        yield
    finally:
        served.ask("/api/v1/drives/fan/lease", {"key": key}, method="DELETE")
        served.until(lambda: not served.runs("fan"))


def test_mbpoll_reads_floats(served, mbpoll):
    with kept_fan(served):
        for table in ("3", "4"):

            def at(address, kind="", table=table):
                found = mbpoll("-a", "3", "-0", "-r", str(address), "-t", f"{table}{kind}", "-B")
                return float(found[address]) if isinstance(found, dict) else math.nan

            served.until(lambda at=at: at(8, ":float") == pytest.approx(25.0, abs=0.1))
            served.until(lambda at=at: at(200, ":float") == pytest.approx(25.0, abs=0.1))
            served.until(lambda at=at: at(10) in (64, 192))


def test_mbpoll_shows_the_exception_of_a_refused_read(served, mbpoll):
    assert "Target device failed to respond" in mbpoll("-a", "247", "-0", "-r", "24", "-t", "3:float", "-B") or (
        "Gateway path unavailable" in mbpoll("-a", "247", "-0", "-r", "24", "-t", "3:float", "-B")
    )
    assert "Gateway path unavailable" in mbpoll("-a", "9", "-0", "-r", "8", "-t", "3:float", "-B")
    assert "Illegal data address" in mbpoll("-a", "3", "-0", "-r", "300", "-t", "4")
    assert "Illegal function" in mbpoll("-a", "3", "-0", "-r", "8", "-t", "0")
    assert "Gateway path unavailable" in mbpoll("-a", "3", "-0", "-r", "24", "-t", "3:float", "-B")
    served.control.order("power", drive="fan", state="off")
    try:
        served.until(
            lambda: "Target device failed to respond" in str(mbpoll("-a", "3", "-0", "-r", "8", "-t", "3:float", "-B"))
        )
    finally:
        served.control.order("power", drive="fan", state="on")
        served.until(lambda: served.drive("fan")["reachability"] == "answers", 30)


def test_mbpoll_stops_a_motor(served, mbpoll):
    with kept_fan(served):
        mbpoll("-a", "3", "-0", "-r", "1000", "-t", "4", write=[1])
        served.until(lambda: not served.runs("fan"))


def test_pymodbus_reads_all_in_one_telegram(served, client):
    def frequency_is_read():
        answer = client.read_input_registers(8, count=2, device_id=3)
        return not answer.isError() and not math.isnan(
            client.convert_from_registers(answer.registers, client.DATATYPE.FLOAT32)
        )

    served.until(frequency_is_read)
    for answer in (
        client.read_input_registers(0, count=120, device_id=3),
        client.read_holding_registers(0, count=120, device_id=3),
    ):
        words = answer.registers
        assert len(words) == 120
        assert words[0] == 1
        frequency, missing = (
            client.convert_from_registers(words[place : place + 2], client.DATATYPE.FLOAT32) for place in (8, 28)
        )
        assert frequency >= 0
        assert math.isnan(missing)


def test_pymodbus_shows_the_exception_of_a_refused_request(client):
    assert client.read_input_registers(0, count=1, device_id=77).exception_code == 10
    assert client.read_input_registers(300, count=1, device_id=3).exception_code == 2
    assert client.read_coils(0, count=1, device_id=3).exception_code == 1
    assert client.write_registers(1004, [9, 0, 0, 0], device_id=3).exception_code == 3


def test_link_loss_policy_acts_after_pymodbus_disconnects(served, client):
    """pymodbus starts the motor by the full handshake and disconnects; then the link-loss policy acts."""
    heartbeat, sequence = 0, 7

    def cycle(condition, seconds=15):
        nonlocal heartbeat
        end = time.monotonic() + seconds
        while not condition(client.read_holding_registers(1008, count=8, device_id=3).registers):
            assert time.monotonic() < end
            heartbeat += 1
            image = [0, heartbeat, sequence, 1, 1, 0, *float_words(50.0)]
            assert not client.write_registers(1000, image, device_id=3).isError()
            time.sleep(0.05)

    cycle(lambda told: told[3] == 1)
    sequence = 8
    cycle(lambda told: told[:2] == [8, 2])
    served.until(lambda: served.runs("fan"))
    client.close()
    served.until(lambda: not served.runs("fan"))
    records = [json.loads(line) for line in next(served.folder.glob("state/**/audit.jsonl")).read_text().splitlines()]
    mine = [
        each for each in records if each["door"] == f"modbus-tcp 127.0.0.1:{served.port}" and each["verb"] == "keep"
    ]
    assert [each["record"] for each in mine] == ["asked", "outcome"]
    assert mine[0]["who"] == "127.0.0.1"


def test_restarted_server_does_not_start_a_motor(served):
    """The PLC still writes the block with which it started a motor."""
    started = struct.pack(">HHHHHHHH", 0, 0, 9, 1, 1, 0, *float_words(50.0))

    def cycles(seconds):
        client = ModbusTcpClient("127.0.0.1", port=served.port, timeout=10)
        with client:
            end = time.monotonic() + seconds
            beat = 100
            while time.monotonic() < end:
                beat += 1
                image = [0, beat, *struct.unpack(">HHHHHH", started[4:])]
                assert not client.write_registers(1000, image, device_id=3).isError()
                time.sleep(0.05)
            return client.read_holding_registers(1008, count=8, device_id=3).registers

    served.start()
    told = cycles(2.5)
    assert told[3] == 1, "the master must hold the lease"
    assert told[:2] == [0, 0], "no command must be carried out"
    assert not served.runs("fan")
