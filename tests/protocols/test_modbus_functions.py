"""Drives that lack a write function or are busy, and registers typed with the numbers of the manuals."""

import pytest
from serving_threads import served_in_thread

import drivecomm
from drivecomm.errors import DriveError, ParameterAddressError, RefusedError
from drivecomm.protocol import Command, Stop, VirtualReply
from drivecomm.protocol.schema import crc16
from drivecomm.virtual import Server, VirtualLine, parse_listen, virtual_drive

WRITES = (5, 6, 15, 16)


def opened(drive):
    line, sent = VirtualLine([drive]), []
    return drivecomm.open_bus(line.port, trace=sent.append), sent, line


def functions(sent):
    """Return the functions of the writes sent, in order."""
    return [each.data[1] for each in sent if each.what == "sent" and each.data[1] in WRITES]


def lacking(model, *without, **options):
    """Return a virtual drive that refuses certain functions as unknown."""
    drive = virtual_drive("modbus", 1, model=model, **options)
    drive._functions = [each for each in (1, 2, 3, 4, *WRITES) if each not in without]
    return drive


@pytest.mark.parametrize(
    ("model", "lacks", "first", "works"),
    [("abb-acs355", 16, 16, 6), ("vacon10", 16, 16, 6), ("gs2", 6, 6, 16), ("hitachi-wj200", 5, 5, 15)],
)
def test_stop_uses_the_other_write_function_and_remembers_it(model, lacks, first, works):
    drive = lacking(model, lacks)
    bus, sent, line = opened(drive)
    with bus:
        one = bus.drive("modbus", 1, model=model)
        drive.motor.run(20, line.time)
        one.stop()
        assert functions(sent)[:2] == [first, works]
        assert drive.motor.command is not Command.RUN
        del sent[:]
        one.stop()
        bus.drive("modbus", 1, model=model).stop()
        assert set(functions(sent)) == {works}


def test_stop_by_the_other_write_function_is_sent_without_a_read():
    bus, sent, _ = opened(lacking("vacon10", 16))
    with bus:
        bus.drive("modbus", 1, model="vacon10").stop()
    assert [each.data[1] for each in sent if each.what == "sent"][:2] == [16, 6]


def test_stop_over_a_network_port_falls_back_to_function_06():
    drive = lacking("optidrive-e3", 16)
    with (
        served_in_thread(Server([drive], parse_listen("tcp:127.0.0.1:0"))) as server,
        drivecomm.open_bus(server.address) as bus,
    ):
        one = bus.drive("modbus", 1, model="optidrive-e3")
        one.set_reference(hz=20)
        one.start()
        assert drive.motor.command is Command.RUN
        one.stop()
    assert drive.motor.command is not Command.RUN


@pytest.mark.parametrize(("model", "running"), [("fuji-frenic", {"hz": 20}), ("danfoss-fc", {"percent": 40})])
def test_stop_uses_coils_if_no_function_writes_registers(model, running):
    drive = virtual_drive("modbus", 1, model=model)
    bus, sent, line = opened(drive)
    with bus:
        one = bus.drive("modbus", 1, model=model)
        one.set_reference(**running)
        one.start()
        line.advance(10)
        drive._functions = [1, 3, 15]
        del sent[:]
        one.stop()
    assert set(functions(sent)[-1:]) == {15}
    assert drive.motor.command is not Command.RUN


def test_start_and_reference_use_the_function_that_the_drive_has():
    drive = lacking("optidrive-e3", 16)
    bus, _, line = opened(drive)
    with bus:
        one = bus.drive("modbus", 1, model="optidrive-e3")
        one.set_reference(hz=20)
        one.start()
        line.advance(30)
        assert drive.motor.running


def test_refusal_of_both_write_functions_names_register_and_option():
    bus, _, _ = opened(lacking("vacon10", 6, 16))
    with (
        bus,
        pytest.raises(
            RefusedError,
            match=r"parameter 2001 with code 1: .*neither function 16 nor 6; see the option write_function",
        ),
    ):
        bus.drive("modbus", 1, model="vacon10").stop()


def test_other_refusal_of_a_write_is_not_retried_with_the_other_function():
    drive = virtual_drive("modbus", 1, model="optidrive-e3")
    bus, sent, _ = opened(drive)
    with bus, pytest.raises(RefusedError, match="code 2"):
        bus.drive("modbus", 1).write("999", 1, type="u16")
    assert functions(sent) == [16]


def busy_for(drive, times, functions_):
    """Make a virtual drive answer its next requests with these functions by exception 06."""
    refused, as_it_is = [], drive.hear

    def hear(find, now):
        reply = as_it_is(find, now)
        if reply is None or find.data[1] not in functions_ or len(refused) >= times:
            return reply
        refused.append(find)
        data = bytes((1, find.data[1] | 0x80, 6))
        return VirtualReply(data=data + crc16(data), delay_s=reply.delay_s)

    drive.hear = hear
    return refused


@pytest.mark.parametrize("times", [1, 3, 1000])
def test_read_of_a_busy_drive_is_retried_for_one_second_at_most(times):
    drive = virtual_drive("modbus", 1, model="gs2")
    bus, _, line = opened(drive)
    refused = busy_for(drive, times, (3,))
    with bus:
        one = bus.drive("modbus", 1, model="gs2")
        if times < 1000:
            assert one.read("0x2103").raw == 0
        else:
            with pytest.raises(RefusedError, match="busy"):
                one.read("0x2103")
            assert 1 < line.time < 2
    assert len(refused) >= min(times, 5)


def test_read_of_a_busy_drive_is_not_retried_beyond_the_deadline():
    drive = virtual_drive("modbus", 1, model="gs2")
    bus, _, line = opened(drive)
    busy_for(drive, 1000, (3,))
    with bus:
        one = bus.drive("modbus", 1, model="gs2", deadline_s=0.3)
        with pytest.raises((DriveError, TimeoutError)):
            one.read("0x2103")
    assert line.time < 0.5


def test_stop_does_not_wait_until_a_busy_drive_can_be_read():
    drive = virtual_drive("modbus", 1, model="bonfiglioli")
    bus, sent, line = opened(drive)
    busy_for(drive, 1000, (3,))
    with bus:
        bus.drive("modbus", 1, model="bonfiglioli").stop(Stop.RAMP)
    assert line.time < 0.3
    assert functions(sent)[0] == 16
    assert next(each.data for each in sent if each.what == "sent" and each.data[1] == 16)[-4:-2] == bytes(2)


def test_refused_register_40003_is_explained_by_register_base():
    bus, _, _ = opened(virtual_drive("modbus", 1, model="optidrive-e3"))
    with bus:
        one = bus.drive("modbus", 1)
        with pytest.raises(RefusedError, match=r"code 2.*counts registers from 40001 on, set register_base=40001"):
            one.read("40003")
        with pytest.raises(RefusedError, match="register_base=40001"):
            one.write("40003", 1, type="u16")
        with pytest.raises(ParameterAddressError, match="register_base=400001"):
            one.read("400003")
        with pytest.raises(RefusedError, match="register_base=30001 and write i30003"):
            one.read("30003")


def test_reading_of_register_40003_has_a_note_on_register_base():
    drive = virtual_drive("modbus", 1, model="fuji-frenic")
    drive._fetch = lambda _kind, _start, count: (0,) * count
    bus, _, _ = opened(drive)
    with bus:
        one = bus.drive("modbus", 1)
        assert "set register_base=40001" in one.read("40003").note
        assert [("register_base" in each.note) for each in one.read_many(["40003", "3"])] == [True, False]
        assert "register_base" not in bus.drive("modbus", 1, register_base=40001).read("40003").note
