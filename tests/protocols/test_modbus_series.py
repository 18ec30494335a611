"""Modbus series as tables: the telegrams of a series come from its model file, not from Python code."""

from pathlib import Path

import pytest

import drivecomm
import drivecomm_modbus
from drivecomm.errors import NoReplyError, NotSupported, ParameterAddressError, RefusedError, StateError, UsageError
from drivecomm.models import check_model, load_model, model_names
from drivecomm.protocol import DriveState, Stop, installed
from drivecomm.virtual import VirtualLine, virtual_drive

PACKAGE = Path(drivecomm_modbus.__file__).parent
NAMES = model_names("drivecomm_modbus", "modbus")
CONTROLS = {name: load_model("drivecomm_modbus", "modbus", name).control for name in NAMES}
COMMANDED = [name for name in NAMES if "stop" in CONTROLS[name]]
INVENTED = """
format = 1
protocol = "modbus"
name = "mill"
title = "Mill drives M1"
source = "manual M-1 p. 3"
[options]
register_base = 40001
word_order = "low"
[quantities]
output_frequency = "40021"
[control]
start = [["40001", 0x0101, 0x0003]]
start_reverse = [["40001", 0x0102, 0x0003]]
stop = [["40001", 0x0100, 0x0003]]
reset = [["40003", 1], ["40003", 0]]
reference_hz = "40005"
fault_code = "40011.high"
plain_write = "volatile"
store_after = [["40099", 0xA5]]
needs = { "40031" = [2] }
exceptions = { 33 = "the motor turns" }
[control.status]
running = ["40010", 0x0001, 0x0001]
reverse = ["40010", 0x0002, 0x0002]
[faults]
7 = "belt torn"
[[parameter]]
address = "40005"
name = "bus_frequency"
kind = "command"
storage = "volatile"
type = "u32"
unit = "Hz"
factor = "0.001"
access = "rw"
maximum = "80"
start = "0"
[[parameter]]
address = "40011.high"
name = "belt_fault"
access = "r"
start = "0"
[[parameter]]
address = "40021"
name = "actual_frequency"
type = "s16"
unit = "Hz"
factor = "0.1"
access = "r"
start = "0"
[[parameter]]
address = "40031"
name = "command_source"
access = "rw"
start = "2"
[[parameter]]
address = "40041"
name = "ramp"
type = "f32"
unit = "s"
access = "rw"
start = "2.5"
"""


@pytest.fixture
def mill(tmp_path):
    path = tmp_path / "mill.toml"
    path.write_text(INVENTED.lstrip(), encoding="utf-8")
    assert [str(finding) for finding in check_model(path)] == []
    return path


def one(model):
    drive = virtual_drive("modbus", 1, model=model)
    line = VirtualLine([drive])
    sent = []
    bus = drivecomm.open_bus(line.port, trace=sent.append)
    return drive, line, bus, sent


def test_no_python_code_is_about_one_series():
    text = "".join(path.read_text(encoding="utf-8") for path in PACKAGE.glob("*.py"))
    assert text.count("\n") <= 1660
    for name in NAMES:
        uses = text.count(f'"{name}"')
        assert uses == (1 if name == installed["modbus"].default_model else 0), name
    assert len(NAMES) >= 17


def test_model_file_of_a_new_series_is_enough_to_command_its_drive(mill):
    virtual, line, bus, _ = one(mill)
    with bus:
        drive = bus.drive("modbus", 1, model=mill)
        drive.set_reference(hz=30)
        drive.start(reverse=True)
        line.advance(20)
        status = drive.status()
        assert (status.state, status.reverse) == (DriveState.RUNNING, True)
        assert str(drive.read("output_frequency")) == "-30.0 Hz"
        drive.stop()
        line.advance(20)
        assert drive.status().state is DriveState.READY
        virtual.trip(7, line.time)
        assert drive.status().fault_text == "belt torn"
        with pytest.raises(StateError, match="reset it first"):
            drive.start()
        drive.reset()
        assert not drive.status().fault
        assert not virtual.motor.running


def test_conditions_of_a_start_are_read_and_never_written(mill):
    virtual, _, bus, _ = one(mill)
    virtual.poke("40031", 1)
    with (
        bus,
        pytest.raises(StateError, match="command_source is 1, and the drive obeys the bus only with 2; set it first"),
    ):
        bus.drive("modbus", 1, model=mill).start()
    assert not virtual.motor.running
    assert virtual.peek("40031", 0.0) == 1


def test_write_is_volatile_unless_followed_by_the_store_command(mill):
    virtual, line, bus, _ = one(mill)
    with bus:
        drive = bus.drive("modbus", 1, model=mill)
        drive.write("ramp", "7.25")
        assert str(drive.read("ramp")) == "7.25 s"
        virtual.power_cycle(line.time)
        assert str(drive.read("ramp")) == "2.5 s"
        drive.write("ramp", "7.25", store=True)
        virtual.power_cycle(line.time)
        assert str(drive.read("ramp")) == "7.25 s"


def test_unlock_is_sent_before_each_write_and_reference(mill):
    text = mill.read_text(encoding="utf-8")
    mill.write_text(text.replace("[control]\n", '[control]\nwrite_before = [["40098", 1]]\n'), encoding="utf-8")
    _, _, bus, sent = one(mill)
    with bus:
        drive = bus.drive("modbus", 1, model=mill)
        for call in (lambda: drive.set_reference(hz=30), lambda: drive.write("ramp", 3)):
            del sent[:]
            call()
            writes = [each.data[2:-2].hex(" ").upper() for each in sent if each.what == "sent" and each.data[1] == 16]
            assert writes[0] == "00 61 00 01 02 00 01"
            assert len(writes) == 2


@pytest.mark.parametrize(
    ("name", "verb", "telegrams"),
    [
        ("delta", lambda drive: drive.stop(), ["01 06 20 00 00 01"]),
        ("delta", lambda drive: drive.set_reference(hz=60), ["01 06 20 01 17 70"]),
        ("gs2", lambda drive: drive.set_reference(hz=25), ["01 06 09 1A 00 FA"]),
        ("gs2", lambda drive: drive.start(), ["01 06 09 1C 00 00", "01 06 09 1B 00 01"]),
        ("fuji-frenic", lambda drive: drive.start(reverse=True), ["01 10 07 06 00 01 02 00 02"]),
        ("bonfiglioli", lambda drive: drive.write("481", "100.25"), ["01 65 51 E1 00 00 27 29"]),
        ("danfoss-fc", lambda drive: drive.start(), ["01 10 C3 4F 00 01 02 04 7C"]),
        ("danfoss-fc", lambda drive: drive.set_reference(percent=50), ["01 10 C3 59 00 01 02 20 00"]),
        ("optidrive-e3", lambda drive: drive.stop(), ["01 06 00 00 00 00"]),
        ("siemens-v20", lambda drive: drive.stop(), ["01 06 00 05 00 00"]),
        ("vacon10", lambda drive: drive.start(reverse=True), ["01 10 07 D0 00 01 02 00 03"]),
        ("toshiba-vfs11", lambda drive: drive.start(), ["01 06 FA 00 C4 00"]),
        ("hitachi-wj200", lambda drive: drive.start(reverse=True), ["01 05 00 01 FF 00", "01 05 00 00 FF 00"]),
        ("hitachi-wj200", lambda drive: drive.set_reference(hz=25), ["01 10 00 00 00 02 04 00 00 09 C4"]),
        ("yaskawa", lambda drive: drive.start(), ["01 10 00 01 00 01 02 00 01"]),
        ("mitsubishi", lambda drive: drive.start(reverse=True), ["01 06 00 08 00 04"]),
        ("mitsubishi", lambda drive: drive.stop(), ["01 06 00 08 00 01"]),
        ("delta-vfd-b", lambda drive: drive.start(), ["01 06 20 00 00 12"]),
        (
            "schneider-atv",
            lambda drive: drive.start(),
            [f"01 10 21 35 00 01 02 00 {word}" for word in ("06", "07", "0F")],
        ),
        (
            "abb-acs355",
            lambda drive: drive.start(),
            [f"01 10 00 00 00 01 02 04 {word}" for word in ("06", "07", "0F", "3F", "7F")],
        ),
    ],
)
def test_telegrams_of_a_series_are_those_of_its_table(name, verb, telegrams):
    _, _, bus, sent = one(name)
    with bus:
        drive = bus.drive("modbus", 1, model=name, confirmed=name)
        drive.status()
        verb(drive)
    writes = [
        event.data[:-2].hex(" ").upper() for event in sent if event.what == "sent" and event.data[1] not in (1, 3)
    ]
    assert writes == telegrams


@pytest.mark.parametrize("name", COMMANDED)
def test_broadcast_stop_stops_all_drives_of_a_series(name):
    drives = [virtual_drive("modbus", address, model=name) for address in (1, 2)]
    line = VirtualLine(drives)
    with drivecomm.open_bus(line.port) as bus:
        for address in (1, 2):
            bus.drive("modbus", address, model=name, confirmed=name).start()
        assert all(drive.motor.running for drive in drives)
        bus.broadcast("modbus", model=name).stop()
        line.advance(30)
        for drive in drives:
            drive.motor.advance(line.time)
        assert not any(drive.motor.running for drive in drives)


def test_commands_without_a_model_are_refused_unsent():
    _, _, bus, sent = one("delta")
    with bus:
        drive = bus.drive("modbus", 1)
        for verb in (drive.start, drive.stop, drive.reset, drive.status, bus.broadcast("modbus").stop):
            with pytest.raises(NotSupported, match="name the drive's model"):
                verb()
        assert sent == []
        assert drive.read("0x2103").raw == 0


def test_printed_register_addresses_are_converted_by_their_base():
    read = installed["modbus"].operations(1, installed["modbus"].options(register_base=40001, coil_base=1), None).read
    assert next(read("40001")).message.start == 0
    assert next(read("c65")).message.start == 64
    assert next(read("i40003")).message.function == 4
    for wrong in ("40000", "c0", "0xZZ", "x1", "40001.16", "c1.low"):
        with pytest.raises(ParameterAddressError):
            next(read(wrong))


def test_mistake_in_a_control_table_is_refused_with_its_key(mill):
    text = mill.read_text(encoding="utf-8")
    mill.write_text(text.replace('stop = [["40001", 0x0100, 0x0003]]', 'stop = [["40001"]]'), encoding="utf-8")
    with pytest.raises(UsageError, match=r"\[control\] stop: a step is"):
        virtual_drive("modbus", 1, model=mill)
    mill.write_text(text.replace("reference_hz", "referenz_hz"), encoding="utf-8")
    assert "did you mean 'reference_hz'" in str(check_model(mill)[0])


def test_exception_code_has_the_text_of_the_maker():
    _, _, bus, _ = one("fuji-frenic")
    with bus, pytest.raises(RefusedError, match="a count that is not allowed"):
        bus.drive("modbus", 1, model="fuji-frenic").read("0x7777")


def test_stop_that_a_series_lacks_is_refused_unsent():
    assert load_model("drivecomm_modbus", "modbus", "delta").control["stop"]
    _, _, bus, sent = one("delta")
    with bus, pytest.raises(NotSupported):
        bus.drive("modbus", 1, model="delta").stop(Stop.QUICK)
    assert sent == []


def operations_of(name, address):
    model, plugin = load_model("drivecomm_modbus", "modbus", name), installed["modbus"]
    own = {key: value for key, value in model.options.items() if hasattr(plugin.options(), key)}
    return plugin.operations(address, plugin.options(**own), model)


@pytest.mark.parametrize("name", COMMANDED)
def test_broadcast_of_another_verb_than_stop_is_refused(name):
    everybody = operations_of(name, 0)
    for verb in (everybody.start, everybody.reset, everybody.status, everybody.probe, everybody.identify):
        with pytest.raises(NotSupported, match="all drives of a series can only be stopped"):
            next(verb())
    assert next(everybody.stop()).message.address == 0


@pytest.mark.parametrize("name", COMMANDED)
def test_stop_is_urgent_and_may_be_repeated(name):
    drive = operations_of(name, 1)
    # Any stop of a Bonfiglioli drive but a coast starts with a read of its control mode.
    stop = next(drive.stop(Stop.COAST if name == "bonfiglioli" else Stop.RAMP))
    assert stop.urgent
    assert stop.attempts is None
    assert stop.acts


def test_start_without_a_reply_is_sent_once():
    virtual, _, bus, sent = one("delta")
    hear = virtual.hear
    virtual.hear = lambda find, now: hear(find, now) if find.data[1] == 3 else None
    with bus, pytest.raises(NoReplyError):
        bus.drive("modbus", 1, model="delta").start()
    assert len([event for event in sent if event.what == "sent" and event.data[1] in (6, 16)]) == 1


def test_write_that_wears_the_eeprom_needs_store(mill):
    text = mill.read_text(encoding="utf-8")
    stored = text.replace('plain_write = "volatile"', 'plain_write = "stored"').replace(
        'store_after = [["40099", 0xA5]]\n', ""
    )
    mill.write_text(stored, encoding="utf-8")
    _, _, bus, sent = one(mill)
    with bus:
        drive = bus.drive("modbus", 1, model=mill)
        with pytest.raises(NotSupported, match="write it with store=True"):
            drive.write("ramp", "7.25")
        assert sent == []
        drive.write("ramp", "7.25", store=True)
