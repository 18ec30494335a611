"""Two objects for one drive: a command by one must not be undone by the other."""

import pytest
from addresses import address_of
from benches import COMMANDED
from two_faces import each_face, open_on

import drivecomm
from drivecomm.errors import StateError
from drivecomm.protocol import Stop, installed
from drivecomm.virtual import VirtualLine, virtual_drive

PROTOCOLS = COMMANDED
SOMETHING = {
    "vabus": "481",
    "danfoss-fc": "16-13",
    "vlt3500": "215",
    "fuji": "M09",
    "modbus": "16130",
    "uss": "1082",
    "huanyang": "CFG1",
    "mitsubishi": "H6F",
    "hitachi": "03-1",
    "ls-bus": "0x0009",
    "movilink": "8300",
    "ct-ansi": "02.01",
    "toshiba": "FD00",
}
PERCENT = ("danfoss-fc", "uss", "vlt3500", "modbus", "movilink")


@pytest.fixture(params=PROTOCOLS)
def line(request):
    return request.param, VirtualLine([virtual_drive(request.param, address_of(request.param, 3))])


def running(line):
    line.drives[0].motor.advance(line.time)
    return line.drives[0].motor.running


def set_off(bus, protocol):
    drive = bus.drive(protocol, address_of(protocol, 3), model=installed[protocol].default_model)
    if protocol in PERCENT:
        drive.set_reference(percent=50)
    else:
        drive.set_reference(hz=25)
    drive.start()
    return drive


def read_something(drive, protocol):
    drive.read(SOMETHING[protocol])
    drive.status()
    if protocol == "fuji":
        drive.call("terminals", X1=True)


@each_face
@pytest.mark.parametrize("how", [Stop.RAMP, Stop.COAST])
def test_stop_by_another_object_is_not_undone_by_reading(face, line, how):
    protocol, virtual = line
    with open_on(face, virtual.port) as bus:
        first = set_off(bus, protocol)
        second = bus.drive(protocol, address_of(protocol, 3), model=installed[protocol].default_model)
        if how not in second.capabilities.stops:
            how = Stop.RAMP
        second.stop(how)
        virtual.advance(20)
        assert not running(virtual)
        read_something(first, protocol)
        virtual.advance(5)
        assert not running(virtual)


@each_face
def test_broadcast_stop_is_not_undone_by_reading(face, line):
    protocol, virtual = line
    with open_on(face, virtual.port) as bus:
        first = set_off(bus, protocol)
        if installed[protocol].broadcast_address is None:
            pytest.skip("its protocol cannot address all drives")
        bus.broadcast(protocol, model=installed[protocol].default_model).stop()
        virtual.advance(20)
        assert not running(virtual)
        read_something(first, protocol)
        virtual.advance(5)
        assert not running(virtual)


@each_face
@pytest.mark.parametrize("who", ["another object", "all"])
def test_stop_written_as_a_parameter_is_not_undone(face, who):
    virtual = VirtualLine([virtual_drive("fuji", 3)])
    with open_on(face, virtual.port) as bus:
        first = set_off(bus, "fuji")
        assert running(virtual)
        (bus.drive("fuji", 3) if who == "another object" else bus.broadcast("fuji")).write("S06", 0)
        virtual.advance(20)
        assert not running(virtual)
        first.call("terminals", X1=True)
        virtual.advance(5)
        assert not running(virtual)


def test_second_program_starts_with_the_reference_already_set(line):
    protocol, virtual = line
    if protocol in ("uss", "movilink"):
        # No manual page says which parameter shows the reference from the bus, so no start uses a guess.
        with drivecomm.open_bus(virtual.port) as bus, pytest.raises(StateError, match="no reference was set"):
            bus.drive(
                protocol, address_of(protocol, 3), **({"model": "movidrive-b"} if protocol == "movilink" else {})
            ).start()
        return
    with drivecomm.open_bus(virtual.port) as bus:
        percent = protocol in PERCENT
        bus.drive(protocol, address_of(protocol, 3), model=installed[protocol].default_model).set_reference(
            **({"percent": 50} if percent else {"hz": 25})
        )
    with drivecomm.open_bus(virtual.port) as bus:
        bus.drive(protocol, address_of(protocol, 3), model=installed[protocol].default_model).start()
        virtual.advance(20)
        virtual.drives[0].motor.advance(virtual.time)
        assert virtual.drives[0].motor.output_hz == pytest.approx(25, abs=0.1)
    with drivecomm.open_bus(virtual.port) as bus:
        third = bus.drive(protocol, address_of(protocol, 3), model=installed[protocol].default_model)
        if protocol == "danfoss-fc":
            # Its reference is sent with a control word, and a program repeats only control words of its own.
            with pytest.raises(StateError, match="came from another program"):
                third.set_reference(percent=20)
            third.start()
            third.status()
        third.set_reference(**({"percent": 20} if percent else {"hz": 10}))
        virtual.advance(20)
        virtual.drives[0].motor.advance(virtual.time)
        assert virtual.drives[0].motor.output_hz == pytest.approx(10, abs=0.1)
