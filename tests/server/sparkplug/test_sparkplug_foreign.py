"""Payloads that a real gateway sent, decoded by three third-party decoders."""

import asyncio
import json
import os
import shutil
import struct
import subprocess
from pathlib import Path

import pytest
from mosquitto import mosquitto, needs_mosquitto
from sparkplug_scenarios import start_and_values

from drivecomm.server.sparkplug import wire
from drivecomm.server.sparkplug.wire import payload_class

pytestmark = [needs_mosquitto, pytest.mark.foreign]

HERE = Path(__file__).parent
TYPES = {3: "Int32", 4: "Int64", 7: "UInt32", 10: "Double", 11: "Boolean", 12: "String"}


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """Return the messages of a gateway: births, data, historical data, and deaths."""
    folder = tmp_path_factory.mktemp("gateway")
    before = os.environ.get("STATE_DIRECTORY")
    os.environ["STATE_DIRECTORY"] = str(folder / "state")
    try:
        with mosquitto(folder / "broker") as broker:
            found = asyncio.run(start_and_values(folder, broker))
    finally:
        os.environ.pop("STATE_DIRECTORY")
        if before is not None:
            os.environ["STATE_DIRECTORY"] = before
    kinds = {each.kind for each in found.heard}
    assert {"NBIRTH", "DBIRTH", "NDATA", "DDATA", "NDEATH"} <= kinds
    return found


def typed(seen):
    """Return the messages with the metric types of their births, as a host remembers them; data omits the types."""
    types, found = {}, []
    for each in seen.heard:
        message = payload_class().FromString(each.data)
        for metric in message.metrics:
            if metric.HasField("datatype"):
                types[metric.alias] = metric.datatype
            else:
                metric.datatype = types[metric.alias]
        found.append(message)
    return found


def value_of(metric):
    which = metric.WhichOneof("value")
    return None if which is None else getattr(metric, which)


def decoded_by(program, messages):
    lines = "\n".join(each.SerializeToString().hex() for each in messages)
    done = subprocess.run(program, input=lines, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == len(messages)
    return zip(messages, found, strict=True)


def sparkplug_payload():
    """Return the path of sparkplug-payload from npm; None without it, or without node."""
    if not shutil.which("node"):
        return None
    folders = [os.environ.get("DRIVECOMM_NODE_MODULES", ""), os.environ.get("NODE_PATH", "")]
    if shutil.which("npm"):
        for where in ([], ["-g"]):
            asked = subprocess.run(["npm", "root", *where], capture_output=True, text=True, timeout=30, check=False)
            folders.append(asked.stdout.strip())
    places = [Path(folder) / "sparkplug-payload" for folder in folders if folder]
    return next((place for place in places if place.is_dir()), None)


@pytest.mark.soak
def test_sparkplug_payload_of_npm_decodes_the_messages(seen):
    place = sparkplug_payload()
    if place is None:
        pytest.skip(
            "node or sparkplug-payload is not installed: npm install sparkplug-payload, DRIVECOMM_NODE_MODULES=..."
        )
    for message, found in decoded_by(["node", str(HERE / "decode_payloads.js"), str(place)], typed(seen)):
        assert found["timestamp"] == message.timestamp
        assert found.get("seq", 0) == message.seq
        for metric, read in zip(message.metrics, found["metrics"], strict=True):
            assert read["type"] == TYPES[metric.datatype]
            assert read.get("name", "") == metric.name
            assert read.get("isHistorical", False) == metric.is_historical
            assert read["value"] == value_of(metric), read
            if "Quality" in metric.properties.keys:
                quality = read["properties"]["Quality"]
                assert quality["type"] == "Int32"
                assert quality["value"] in (0, 192, 500)
                assert read["properties"]["Uncertain"]["type"] == "Boolean"


def test_pysparkplug_decodes_the_messages(seen):
    python = os.environ.get("DRIVECOMM_PYSPARKPLUG_PYTHON", "")
    if not python:
        pytest.skip(
            "pysparkplug needs an old paho-mqtt: name the Python of a venv with both in DRIVECOMM_PYSPARKPLUG_PYTHON"
        )
    messages = [payload_class().FromString(each.data) for each in seen.heard]
    for message, found in decoded_by([python, str(HERE / "decode_payloads.py")], messages):
        assert found["timestamp"] == message.timestamp
        assert found["seq"] == (message.seq if message.HasField("seq") else None)
        for metric, read in zip(message.metrics, found["metrics"], strict=True):
            assert read["value"] == value_of(metric)
            assert (read["name"], read["timestamp"]) == (metric.name, metric.timestamp)
            assert (read["null"], read["historical"]) == (metric.is_null, metric.is_historical)
            assert read["quality"] in (None, 0, 192, 500)


@pytest.mark.soak
def test_tshark_dissects_the_messages(seen, tmp_path):
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("tshark is not installed (apt install tshark)")
    packets = [each for each in seen.packets if each.kind in ("CONNECT", "PUBLISH")]
    assert packets[0].version == 5
    capture = tmp_path / "sent.pcap"
    capture.write_bytes(_capture([each.raw for each in packets]))
    fields = ["mqtt.msgtype", "mqtt.topic", "mqtt.willtopic", "mqtt.conflag.qos", "mqtt.retain", "frame.protocols"]
    options = [part for field in fields for part in ("-e", field)]
    done = subprocess.run(
        [tshark, "-r", str(capture), "-T", "json", *options],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = [each["_source"]["layers"] for each in json.loads(done.stdout)]
    assert len(found) == len(packets)
    for packet, layers in zip(packets, found, strict=True):
        if packet.kind == "CONNECT":
            assert layers["mqtt.willtopic"] == [packet.will_topic]
            assert layers["mqtt.conflag.qos"] == ["1"]
        else:
            assert layers["mqtt.topic"] == [packet.topic]
            assert "sparkplug" in layers["frame.protocols"][0], layers
    # tshark has the dissector, and reads the message types from a file.
    (tmp_path / "payload.proto").write_text(_described())
    said = [
        "-o", "protobuf.preload_protos:TRUE", "-o", f'uat:protobuf_search_paths:"{tmp_path}","TRUE"',
    ]  # fmt: skip
    text = subprocess.run(
        [tshark, *said, "-r", str(capture), "-V"], capture_output=True, text=True, timeout=120, check=False
    )
    for expected in ("Node Control/Rebirth", "bdSeq", "Values/output_frequency", "engUnit"):
        assert expected in text.stdout
    assert "Malformed" not in text.stdout


def _capture(packets):
    """Return a capture file in Wireshark's format for exported PDUs, which names the dissector of its packets."""
    upper_pdu, end_of_tags, name_tag, name = 252, b"\0\0\0\0", 12, b"mqtt"
    whole = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 1 << 18, upper_pdu)
    for number, packet in enumerate(packets):
        data = struct.pack(">HH", name_tag, len(name)) + name + end_of_tags + packet
        whole += struct.pack("<IIII", 1_700_000_000 + number, 0, len(data), len(data)) + data
    return whole


def _described():
    """Return the messages of a payload as a .proto file, with the package name that Wireshark expects."""
    lines = ['syntax = "proto2";', "package com.cirruslink.sparkplug.protobuf;"]
    for name, text in wire._MESSAGES.items():
        lines.append(f"message {name} {{")
        for field in text.replace(" | ", ", ").split(", "):
            called, number, kind = field.split()
            label = "repeated" if kind.startswith("*") else "optional"
            lines.append(f"  {label} {kind.removeprefix('*')} {called} = {number};")
        lines.append("}")
    return "\n".join(lines) + "\n"
