"""Virtual drives with the state machine of a standard, which react to any control word as the standard says."""

import pytest

import drivecomm
from drivecomm.models import load_model, model_names
from drivecomm.protocol import DriveState, Stop
from drivecomm.virtual import VirtualLine, virtual_drive

NOT_READY, READY, RUNNING, STOPPING = DriveState.NOT_READY, DriveState.READY, DriveState.RUNNING, DriveState.STOPPING

CIA_402 = {
    0x000F: (RUNNING, 20),
    0x0007: (READY, 0),  # disable operation
    0x0006: (READY, 0),  # shutdown
    0x000E: (READY, 0),
    0x000B: (NOT_READY, 0),  # quick stop
    0x0002: (NOT_READY, 0),
    0x000D: (NOT_READY, 0),  # disable voltage
    0x0000: (NOT_READY, 0),
    0x0080: (NOT_READY, 0),
    0x0407: (READY, 0),
}
PROFIDRIVE = {
    0x047F: (RUNNING, 20),
    0x047E: (READY, 0),  # OFF1
    0x0406: (READY, 0),
    0x047D: (NOT_READY, 0),  # OFF2
    0x047B: (NOT_READY, 0),  # OFF3
    0x0477: (READY, 0),  # operation inhibited
    0x0400: (NOT_READY, 0),
    0x043F: (RUNNING, 0),  # bit 6: reference 0
    0x046F: (RUNNING, 0),  # bit 4: ramp output 0
    0x045F: (RUNNING, 20),  # bit 5: ramp held
    0x0C7F: (RUNNING, -20),
    # Without bit 10 the drive ignores the whole word.
    0x0000: (RUNNING, 20),
    0x000B: (RUNNING, 20),
    0x007E: (RUNNING, 20),
}
ABB_LIMITED = {
    0x006F: (RUNNING, 20),
    0x047F: (RUNNING, 20),
    0x006E: (READY, 0),  # OFF1
    0x0006: (READY, 0),
    0x006D: (NOT_READY, 0),  # OFF2
    0x006B: (NOT_READY, 0),  # OFF3
    0x000B: (NOT_READY, 0),
    0x0000: (NOT_READY, 0),
    0x0007: (READY, 0),  # operation inhibited
    0x002F: (RUNNING, 0),  # bit 6: ramp input 0
    0x080F: (RUNNING, 20),  # bits 5 and 6: ramp held
}
ABB_FULL = {
    0x047F: (RUNNING, 20),
    0x047E: (READY, 0),
    0x0407: (READY, 0),
    0x046F: (RUNNING, 0),  # bit 4: ramp output 0
    # Without bit 10 only OFF1, OFF2 and OFF3 act.
    0x0006: (READY, 0),
    0x000B: (NOT_READY, 0),
    0x0000: (NOT_READY, 0),
    0x0007: (RUNNING, 20),
    0x000F: (RUNNING, 20),
}
FC = {
    0x047C: (RUNNING, 20),
    0x047F: (RUNNING, 20),
    0x043C: (READY, 0),
    0x0474: (NOT_READY, 0),
    0x046C: (READY, 0),  # quick stop
    0x0478: (READY, 0),  # DC brake
    0x845C: (RUNNING, 20),  # hold
    0x847C: (RUNNING, -20),
    0x0000: (RUNNING, 20),  # no bit 10
    0x003C: (RUNNING, 20),
    0x0400: (NOT_READY, 0),
}
FUJI = {0x0001: (RUNNING, 20), 0x0002: (RUNNING, -20), 0x0000: (READY, 0), 0x0003: (READY, 0), 0x8000: (READY, 0)}

WIRE = {
    "bonfiglioli": (410, CIA_402 | {0x080F: (RUNNING, 20)}),
    "schneider-atv": (8501, CIA_402 | {0x080F: (RUNNING, -20), 0x010F: (RUNNING, 0)}),
    "abb-acs355": (0, ABB_LIMITED),
    "abb-acs580": (0, ABB_FULL),
    "siemens-g120": (99, PROFIDRIVE),
    "siemens-v20": (99, PROFIDRIVE),
    "danfoss-fc": (49999, FC),
    "fuji-frenic": (0x0706, FUJI),
}
"""By model: the register of its control word as sent, and the effect of each word on a motor that runs at 20 Hz."""


class Plant:
    """A virtual drive started by its own model, and a second master without a model on the same line."""

    def __init__(self, name):
        self.virtual = virtual_drive("modbus", 1, model=name)
        self.line = VirtualLine([self.virtual])
        self.bus = drivecomm.open_bus(self.line.port)
        self.drive = self.bus.drive("modbus", 1, model=name)
        known = load_model("drivecomm_modbus", "modbus", name).options
        same = {key: known[key] for key in ("baudrate", "parity", "write_function") if key in known}
        self.other = self.bus.drive("modbus", 1, **same)
        self.control_word = WIRE[name][0]

    def start(self):
        self.drive.set_reference(**({"hz": 20} if self.drive.capabilities.reference_hz else {"percent": 40}))
        self.drive.start()
        assert self.passes(60) == 20

    def passes(self, seconds):
        """Advance the time; return the signed output frequency in Hz."""
        self.line.advance(seconds)
        self.virtual.follow(self.line.time)
        return round(self.virtual.motor.output_hz)

    def write(self, word):
        self.other.write(str(self.control_word), word)


@pytest.fixture
def plant(name):
    made = Plant(name)
    with made.bus:
        yield made


@pytest.mark.parametrize(
    ("name", "word", "expected"),
    [(name, word, said) for name, (_, words) in WIRE.items() for word, said in words.items()],
    ids=lambda value: f"{value:04X}" if isinstance(value, int) else None,
)
def test_control_word_of_another_master_acts_as_in_the_standard(plant, word, expected):
    plant.start()
    plant.write(word)
    hz = plant.passes(60)
    assert (plant.drive.status().state, hz) == expected


STARTS = {
    "bonfiglioli": [[0x0006, 0x0007, 0x000F], [0x0006, 0x000F]],
    "schneider-atv": [[0x0006, 0x0007, 0x000F], [0x0006, 0x080F]],
    "abb-acs355": [[0x0006, 0x0007, 0x007F], [0x0476, 0x047F]],
    "abb-acs580": [[0x0476, 0x0477, 0x047F], [0x047E, 0x047F]],
    "siemens-g120": [[0x047E, 0x047F], [0x0406, 0x040F, 0x0C7F]],
    "siemens-v20": [[0x047E, 0x047F], [0x0406, 0x040F, 0x0C7F]],
    "danfoss-fc": [[0x043C, 0x047C], [0x847F]],
    "fuji-frenic": [[0x0001], [0x0002]],
}
NO_STARTS = {
    "bonfiglioli": [[0x000F], [0x0007, 0x000F]],
    "schneider-atv": [[0x000F], [0x080F]],
    "abb-acs355": [[0x007F], [0x0007, 0x000F]],
    # Words without bit 10 start no motor.
    "abb-acs580": [[0x047F], [0x0006, 0x0007, 0x000F, 0x007F]],
    "siemens-g120": [[0x047F], [0x007E, 0x007F]],
    "siemens-v20": [[0x007E, 0x007F]],
    "danfoss-fc": [[0x007C], [0x043C]],
    "fuji-frenic": [[0x0003], [0x8000]],
}


def ordered(name, words):
    """Return the plant after another master has sent a reference and these words."""
    plant = Plant(name)
    plant.drive.set_reference(**({"hz": 20} if plant.drive.capabilities.reference_hz else {"percent": 40}))
    for word in words:
        plant.write(word)
    return plant


@pytest.mark.parametrize(("name", "words"), [(name, each) for name, ways in STARTS.items() for each in ways])
def test_words_of_another_master_start_the_virtual_drive(name, words):
    plant = ordered(name, words)
    with plant.bus:
        assert abs(plant.passes(60)) == 20
        assert plant.drive.status().state is RUNNING


@pytest.mark.parametrize(("name", "words"), [(name, each) for name, ways in NO_STARTS.items() for each in ways])
def test_words_without_a_valid_start_leave_the_motor_off(name, words):
    plant = ordered(name, words)
    with plant.bus:
        assert plant.passes(60) == 0
        assert not plant.virtual.motor.running
        assert plant.drive.status().state in (READY, NOT_READY)


@pytest.mark.parametrize("name", WIRE)
def test_reset_bit_left_set_resets_once(name, plant):
    reset = {"siemens": 0x04FE, "abb": 0x04FE, "danfoss": 0x04BC, "fuji": 0x8000}.get(name.split("-")[0], 0x0080)
    plant.start()
    plant.virtual.trip(3, plant.line.time)
    plant.line.advance(60)
    plant.write(reset)
    assert not plant.drive.status().fault
    plant.virtual.trip(3, plant.line.time)
    plant.line.advance(60)
    plant.write(reset)
    assert plant.drive.status().fault


def test_bonfiglioli_ignores_a_reset_within_15_seconds_of_a_trip():
    plant = Plant("bonfiglioli")
    with plant.bus:
        plant.virtual.trip(3, plant.line.time)
        plant.line.advance(14)
        plant.write(0x0080)
        plant.write(0x0000)
        assert plant.drive.status().fault
        plant.line.advance(1)
        plant.write(0x0080)
        assert not plant.drive.status().fault


def test_bonfiglioli_shows_a_running_motor_during_a_quick_stop():
    plant = Plant("bonfiglioli")
    with plant.bus:
        plant.start()
        plant.drive.stop(Stop.QUICK)
        status = plant.drive.status()
        assert (status.state, status.running) == (STOPPING, True)


def test_danfoss_drive_is_ready_after_a_stop_by_its_watchdog():
    plant = Plant("danfoss-fc")
    with plant.bus:
        plant.virtual.poke("8030", 10)
        plant.virtual.poke("8040", 2)
        plant.drive.set_reference(percent=40)
        plant.drive.start()
        assert plant.passes(60) == 0
        assert plant.drive.status().state is READY
        assert not plant.virtual.motor.running
        plant.write(0x047C)
        assert plant.drive.status().state is RUNNING


def test_model_with_standard_control_words_names_its_state_machine():
    """A model whose start ends with a word of CiA 402, PROFIdrive or ABB Drives needs that state machine."""
    runs = {0x000F, 0x006F, 0x007F, 0x046F, 0x047F, 0x047C}
    named = set()
    for name in model_names("drivecomm_modbus", "modbus"):
        control = load_model("drivecomm_modbus", "modbus", name).control
        if control.get("start") and control["start"][-1][1] in runs:
            assert "state_machine" in control, f"{name} would obey only the words of its own model"
        if "state_machine" in control:
            named.add(name)
    assert named >= set(WIRE)
