"""Each Modbus model on a virtual drive of every other series: only a stop may start or reverse the motor."""

import pytest

import drivecomm
from drivecomm.errors import DriveCommError, WrongDriveError
from drivecomm.models import packaged_models, read_model
from drivecomm.protocol import Motor, Stop
from drivecomm.virtual import VirtualLine, virtual_drive

MODELS = {path.stem: read_model(path, "modbus", "drivecomm_modbus") for path in packaged_models("drivecomm_modbus")}
COMMANDED = sorted(name for name, model in MODELS.items() if model.control.get("start"))


def set_and_start(drive):
    drive.set_reference(**({"hz": 20} if drive.capabilities.reference_hz else {"percent": 40}))
    drive.start()


VERBS = {
    "start": lambda drive: drive.start(),
    "reverse": lambda drive: drive.start(reverse=True),
    "jog": lambda drive: drive.jog(),
    "reference and start": set_and_start,
    "negative reference": lambda drive: drive.set_reference(hz=-20),
    "reset": lambda drive: drive.reset(),
}
STOPS = {how.value: lambda drive, how=how: drive.stop(how) for how in Stop}
COMMON = ("baudrate", "parity", "stopbits", "bytesize")


@pytest.fixture
def runs(monkeypatch):
    """Return a list that collects the frequencies at which motors are run."""
    told, run = [], Motor.run
    monkeypatch.setattr(Motor, "run", lambda motor, hz, now: (told.append(hz), run(motor, hz, now))[1])
    return told


def commanded(verb, name, drive, **options):
    """Carry out a verb of a model on a drive, at the line settings of the drive; return the error, if any."""
    facts = {each: getattr(drive.settings, each) for each in COMMON}
    with drivecomm.open_bus(VirtualLine([drive]).port) as bus:
        try:
            verb(bus.drive("modbus", 1, model=name, **facts, **options))
        except DriveCommError as error:
            return error
    return None


def drive_of(name, *, running=False):
    drive = virtual_drive("modbus", 1, model=name)
    if running:
        drive.motor.run(30.0, 0.0)
    return drive


@pytest.mark.parametrize("name", COMMANDED)
def test_model_neither_starts_nor_reverses_a_drive_of_another_series(name, runs):
    started = []
    for other in MODELS.keys() - {name}:
        for title, verb in VERBS.items():
            error = commanded(verb, name, drive_of(other))
            if runs:
                started.append((other, title))
            runs.clear()
            # A verb that is refused before any write does nothing to a running motor either.
            if not isinstance(error, WrongDriveError):
                running = drive_of(other, running=True)
                runs.clear()
                commanded(verb, name, running)
                started += [(other, title, hz) for hz in runs if hz <= 0]
                runs.clear()
    assert not started


@pytest.mark.parametrize("name", COMMANDED)
def test_start_is_refused_if_the_stop_of_the_model_would_start_the_drive(name, runs):
    for other in MODELS.keys() - {name}:
        for stop in STOPS.values():
            commanded(stop, name, drive_of(other))
        if runs:
            assert isinstance(commanded(VERBS["start"], name, drive_of(other)), WrongDriveError), other
        runs.clear()


def test_stop_of_another_series_is_sent_even_if_it_starts_the_motor(runs):
    """A stop is never held back; an unproven model is reported at the start instead."""
    assert commanded(STOPS["ramp"], "delta", drive_of("invt")) is None
    assert runs


@pytest.mark.parametrize("name", COMMANDED)
def test_confirmed_model_starts_a_drive_of_its_own_series(name):
    drive = virtual_drive("modbus", 1, model=name)
    assert commanded(set_and_start, name, drive, confirmed=name) is None
    assert drive.motor.running
