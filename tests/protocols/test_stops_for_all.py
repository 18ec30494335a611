"""Broadcast stops of one protocol must start no drive of another: telegrams of USS and FC look alike."""

import pytest

import drivecomm
from drivecomm.profiles import control_profile
from drivecomm.protocol import Stop
from drivecomm.virtual import VirtualLine, virtual_drive

FAMILY = ("profidrive", "danfoss-fc", "danfoss-profidrive")
STOPS = [(protocol, how) for protocol in ("uss", "danfoss-fc") for how in (Stop.RAMP, Stop.COAST, Stop.QUICK)]


def words_to_all(protocol, how, **options):
    line, heard = VirtualLine([]), []
    with drivecomm.open_bus(line.port, trace=heard.append) as bus:
        bus.broadcast(protocol, **options).stop(how)
    return [event.message.control_word for event in heard if event.what == "sent"]


@pytest.mark.parametrize(("protocol", "how"), STOPS)
def test_words_of_a_broadcast_stop_run_no_motor_in_any_related_profile(protocol, how):
    for word in words_to_all(protocol, how):
        for name in FAMILY:
            known = control_profile(name)
            assert not known.lets_run(word), (name, f"{word:04X}")
            assert known.asks(word) in ("off", "ramp", "quick"), (name, f"{word:04X}")


@pytest.mark.parametrize(("protocol", "how"), STOPS)
@pytest.mark.parametrize("profile", ["fc", "profidrive"])
def test_broadcast_stop_does_not_start_a_danfoss_drive_with_uss_addresses(protocol, how, profile):
    neighbour = virtual_drive("danfoss-fc", 3, address_format="1-31", profile=profile, baudrate=9600)
    line = VirtualLine([neighbour, virtual_drive("uss", 4)])
    with drivecomm.open_bus(line.port) as bus:
        given = {"address_format": "1-31", "profile": profile, "baudrate": 9600}
        drive = bus.drive("danfoss-fc", 3, **given)
        drive.set_reference(percent=50)
        for runs in (False, True):
            if runs:
                drive.start()
            bus.broadcast(protocol, **(given if protocol == "danfoss-fc" else {})).stop(how)
            line.advance(30)
            neighbour.motor.advance(line.time)
            assert not neighbour.motor.running or (protocol == "uss" and runs)
