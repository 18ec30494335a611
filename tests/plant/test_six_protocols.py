"""One line and plant file with a drive of each protocol: found, identified, backed up, started and stopped."""

import pytest
from benches import COMMANDED

import drivecomm
from drivecomm.bus import policies
from drivecomm.commissioning.parameter_sets import back_up
from drivecomm.plant import read_plant
from drivecomm.protocol import Stop, installed
from drivecomm.virtual import VirtualPlant

DRIVES = {
    "vabus:1": 'model = "agile"',
    "danfoss-fc:2": 'model = "fc302"',
    "vlt3500:3": 'model = "vlt3500"',
    "fuji:4": 'model = "frenic"',
    "uss:5": 'model = "micromaster4"',
    "huanyang:7": 'model = "hy"',
    "mitsubishi:8": 'model = "fr700"',
    "movilink:9": 'model = "movidrive-b"',
    "hitachi:10": 'model = "sj300"',
    "ls-bus:11": 'model = "ig5a"',
    "ct-ansi:12": 'model = "unidrive-sp"',
    "toshiba:13": 'model = "vf-s11"',
    # With parity N a scan finds this drive: it asks with the usual settings of a protocol, not with Danfoss's 8E1.
    "modbus:6": 'model = "danfoss-fc", parity = "N"',
}
HEAD = '[[drive]]\nname = "d{1}"\ndrive = "{0}:{1}"\nline = "hall"\narmed = true\noptions = {{ {2} }}\n'


@pytest.fixture
def plant(tmp_path):
    file = tmp_path / "plant.toml"
    drives = "".join(HEAD.format(*name.split(":"), options) for name, options in DRIVES.items())
    file.write_text('format = 1\n[[line]]\nname = "hall"\nport = "/dev/null"\n' + drives, encoding="utf-8")
    return read_plant(file)


def test_plant_holds_all_protocols_that_command_drives():
    assert {name.partition(":")[0] for name in DRIVES} == set(COMMANDED)


def test_drives_of_all_protocols_are_found_backed_up_started_and_stopped(plant):
    line = VirtualPlant(plant).line("hall")
    with drivecomm.open_bus(line.port) as bus:
        found = {each.name: each for each in bus.scan(addresses=range(1, len(DRIVES) + 1))}
        assert {name for name, each in found.items() if each.sound} == set(DRIVES)
        assert not any(virtual.motor.running for virtual in line.drives)
        for config, virtual in zip(plant.drives, line.drives, strict=True):
            drive = config.build(bus.drive)
            drive.identify()
            # Of LS drives only the common area is known; it is lost without power, so no backup holds it.
            assert back_up(drive).entries or config.protocol == "ls-bus"
            policy = next((each for each in policies(drive.model) if each != "hold"), None)
            # Hitachi and LS drives take hertz only: no page that we have seen gives their maximum frequency.
            drive.set_reference(**({"percent": 20} if drive.capabilities.reference_percent else {"hz": 10}))
            if policy is None:
                # Without a known watchdog (VLT 3500, MOVIDRIVE, LS, ...) a drive keeps running on a silent line.
                drive.start()
            else:
                with drivecomm.keep(drive, policy, watchdog_s=2) as kept:
                    drive.start()
                    kept.sleep(1)
                    assert drive.status().running
                line.advance(30)
                virtual.motor.advance(line.time)
                assert not virtual.motor.running
                drive.start()
        line.advance(1)
        assert all(virtual.motor.running for virtual in line.drives)
        for config in plant.drives:
            # Mitsubishi drives are stopped one by one, because their protocol has no broadcast.
            has_one = installed[config.protocol].broadcast_address is not None
            everybody = bus.broadcast(config.protocol, **config.options) if has_one else config.build(bus.drive)
            everybody.stop(Stop.RAMP if Stop.RAMP in everybody.capabilities.stops else Stop.COAST)
        line.advance(30)
        for virtual in line.drives:
            virtual.motor.advance(line.time)
        assert not any(virtual.motor.running for virtual in line.drives)
