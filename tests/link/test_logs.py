"""Line events as log records, and several trace functions on one bus."""

import io
import json
import logging
import subprocess
import sys
from contextlib import suppress

import pytest
from addresses import address_of

import drivecomm
from drivecomm.errors import NotSupported
from drivecomm.link import LOGGER_NAME, combine_traces, log_events
from drivecomm.plant import FaultPlan, LineFault
from drivecomm.protocol import fields_of, installed
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture
def line():
    return VirtualLine([virtual_drive("vabus", 1)])


def read(line, trace, **options):
    with drivecomm.open_bus(line.port, trace=trace, **options) as bus:
        return bus.drive("vabus", 1).read("481")


def test_each_event_is_one_record_with_its_fields(line, caplog):
    seen = []
    caplog.set_level(logging.DEBUG, LOGGER_NAME)
    read(line, combine_traces(seen.append, log_events()))
    assert [record.what for record in caplog.records] == ["sent", "received", "sent"]
    for record, event in zip(caplog.records, seen, strict=True):
        assert (record.name, record.levelno) == ("drivecomm.line", logging.DEBUG)
        assert (record.drive, record.detail) == ("vabus:1", event.detail)
        assert bytes.fromhex(record.data) == event.data
        assert record.fields == fields_of(event.message)
        assert record.line_time == pytest.approx(event.time, abs=1e-6)
    assert caplog.records[0].getMessage() == "vabus:1 sent 04 41 30 30 34 38 31 05 enquiry"


def test_log_events_uses_a_given_logger(line, caplog):
    caplog.set_level(logging.DEBUG)
    read(line, log_events(logging.getLogger("plant.line2")))
    assert {record.name for record in caplog.records} == {"plant.line2"}


def test_log_level_depends_on_the_kind_of_event(caplog):
    caplog.set_level(logging.DEBUG)
    faults = FaultPlan(rate=0.6, seed=5, kinds=[LineFault.CORRUPT, LineFault.DUPLICATE, LineFault.TRUNCATE])
    line = VirtualLine([virtual_drive("vabus", 1)], echo=True, faults=faults)
    with drivecomm.open_bus(line.port, trace=log_events(), echo="auto") as bus:
        drive = bus.drive("vabus", 1)
        for _ in range(80):
            try:
                drive.read("481")
            except drivecomm.DriveCommError:
                line.advance(5)
    levels = {(record.what, record.levelname) for record in caplog.records}
    assert levels == {
        ("sent", "DEBUG"),
        ("received", "DEBUG"),
        ("echo", "DEBUG"),
        ("note", "INFO"),
        ("damaged", "WARNING"),
        ("noise", "WARNING"),
        ("stray", "WARNING"),
    }
    damaged = next(record for record in caplog.records if record.what == "damaged")
    assert damaged.detail
    assert damaged.fields is None
    assert damaged.detail in damaged.getMessage()


def test_disabled_log_records_are_not_decoded(line, monkeypatch):
    logger = logging.getLogger(LOGGER_NAME)
    logger.setLevel(logging.WARNING)
    monkeypatch.setattr("drivecomm.link.tracing.fields_of", lambda _: pytest.fail("decoded for nobody"))
    try:
        read(line, log_events())
    finally:
        logger.setLevel(logging.NOTSET)


def test_json_formatter_needs_only_the_standard_library(line):
    class AsJson(logging.Formatter):
        def format(self, record):
            names = ("what", "drive", "data", "fields", "detail", "line_time")
            return json.dumps({"level": record.levelname, **{name: getattr(record, name) for name in names}})

    logger, output = logging.getLogger("drivecomm.tests.apart"), io.StringIO()
    logger.setLevel(logging.DEBUG)
    handler = logging.StreamHandler(output)
    handler.setFormatter(AsJson())
    logger.addHandler(handler)
    read(line, log_events(logger))
    first = json.loads(output.getvalue().splitlines()[0])
    assert first["fields"] == {"kind": "enquiry", "address": 1, "sys": 0, "dataset": 0, "parameter": 481}


@pytest.mark.parametrize("protocol", drivecomm.protocols())
def test_fields_of_every_protocol_are_json(protocol, caplog):
    caplog.set_level(logging.DEBUG)
    address = address_of(protocol)
    line = VirtualLine([virtual_drive(protocol, address)])
    with drivecomm.open_bus(line.port, trace=log_events()) as bus:
        plugin = installed[protocol]
        drive = bus.drive(protocol, address, model=plugin.default_model)
        with suppress(NotSupported):  # a model may have no status
            drive.status()
        drive.read(plugin.parameter_examples[0])
        drive.identify()
        if drive.capabilities.faults and not drive.capabilities.monitoring_only:
            drive.reset()
    assert len(caplog.records) >= 2
    assert all(json.dumps(record.fields) for record in caplog.records)


def test_combine_traces_adds_no_wrapper_to_a_single_function():
    seen = []
    assert combine_traces() is None
    assert combine_traces(None, None) is None
    assert combine_traces(None, seen.append) == seen.append


def test_drivecomm_does_not_load_logging():
    code = "import sys, drivecomm; drivecomm.open_bus; sys.exit('logging' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
