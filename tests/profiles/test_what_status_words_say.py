"""Status words as printed in the manuals, with every value of the bits left open."""

import itertools

import pytest

from drivecomm.profiles import control_profile
from drivecomm.protocol import DriveState

DRIVECOM = {
    "xxxx xxxx x0xx 0000": "not ready to switch on",
    "xxxx xxxx x1xx 0000": "switch on disabled",
    "xxxx xxxx x01x 0001": "ready to switch on",
    "xxxx xxxx x01x 0011": "switched on",
    "xxxx xxxx x01x 0111": "operation enabled",
    "xxxx xxxx x00x 0111": "quick stop active",
    "xxxx xxxx x0xx 1111": "fault reaction active",
    "xxxx xxxx x0xx 1000": "fault",
}
PROFIDRIVE = {
    "xxxx xxxx x1xx 0xxx": DriveState.NOT_READY,
    "xxxx xxxx xxxx 1xxx": DriveState.FAULT,
    "xxxx xxxx x0xx 0xx0": DriveState.NOT_READY,
    "xxxx xxxx x01x 0001": DriveState.READY,
    "xxxx xxxx x01x 0011": DriveState.READY,
    "xxxx xxxx x01x 0111": DriveState.RUNNING,
    "xxxx xxxx x00x 0111": DriveState.STOPPING,
}
FC = {
    "xxxx xxxx x1xx xxxx": DriveState.FAULT,
    "xxxx xxxx xxxx 1xxx": DriveState.FAULT,
    "xxxx 1xxx x0xx 0xxx": DriveState.RUNNING,
    "xxxx 0xxx x0xx 0111": DriveState.READY,
    "xxxx 0xxx x0xx 0011": DriveState.NOT_READY,
    "xxxx 0xxx x0xx 0000": DriveState.NOT_READY,
}
VLT_3500 = {
    "xxxx xxxx xxxx 1xxx": DriveState.FAULT,
    "xxxx 1xxx xx0x 0xxx": DriveState.RUNNING,
    "xxxx 1xxx xx1x 0xxx": DriveState.STOPPING,
    "xxxx 0xxx x0xx 0x11": DriveState.READY,
    "xxxx 0xxx x1xx 0x11": DriveState.NOT_READY,
    "xxxx 0xxx x0xx 0x00": DriveState.NOT_READY,
}


def words(pattern):
    """Yield words that match a pattern: all values of the lowest six open bits, with the others all 0 and all 1."""
    bits = pattern.replace(" ", "")
    for fill in itertools.product("01", repeat=min(6, bits.count("x"))):
        for rest in "01":
            left = iter(reversed(fill))
            yield int("".join(next(left, rest) if bit == "x" else bit for bit in reversed(bits))[::-1], 2)


@pytest.mark.parametrize(("pattern", "name"), DRIVECOM.items())
def test_drivecom_status_word_gives_the_printed_state(pattern, name):
    assert {control_profile("drivecom").state_of({"": word}).name for word in words(pattern)} == {name}


@pytest.mark.parametrize(("pattern", "state"), PROFIDRIVE.items())
def test_profidrive_status_word_gives_the_printed_state(pattern, state):
    assert {control_profile("profidrive").status({"": word}).state for word in words(pattern)} == {state}


@pytest.mark.parametrize(("pattern", "state"), FC.items())
def test_fc_profile_status_word_gives_the_printed_state(pattern, state):
    assert {control_profile("danfoss-fc").status({"": word}).state for word in words(pattern)} == {state}


@pytest.mark.parametrize(("pattern", "state"), VLT_3500.items())
def test_vlt_3500_status_word_gives_the_printed_state(pattern, state):
    assert {control_profile("vlt3500").status({"": word}).state for word in words(pattern)} == {state}


@pytest.mark.parametrize("name", ["vlt3500", "danfoss-fc", "danfoss-profidrive"])
def test_each_bit_is_a_flag_in_profiles_without_named_states(name):
    profile = control_profile(name)
    assert all(profile.status({"": 1 << bit}).flags == (profile.flags[bit],) for bit in range(16))


def test_vlt_3500_bits_have_the_names_of_the_manuals():
    # VLT 3000 manual p. 78 (0 to 8), VLT 3500 manual p. 91, VLT 2000 manual p. 36.
    assert list(control_profile("vlt3500").flags.items()) == [
        (0, "control ready"),
        (1, "drive ready"),
        (2, "enabled"),
        (3, "tripped"),
        (4, "OFF2"),
        (5, "OFF3"),
        (6, "start not possible"),
        (7, "warning"),
        (8, "speed equals the reference"),
        (9, "bus control"),
        (10, "frequency in range"),
        (11, "running"),
        (12, "stopped by overload"),
        (13, "voltage outside its limits"),
        (14, "current limit exceeded"),
        (15, "thermal timer above 100 %"),
    ]


def test_fc_and_profidrive_flags_of_danfoss_differ_in_bits_4_to_6_only():
    fc, profidrive = control_profile("danfoss-fc").flags, control_profile("danfoss-profidrive").flags
    assert {bit for bit in range(16) if fc[bit] != profidrive[bit]} == {4, 5, 6}
    assert (fc[13], fc[14]) == ("DC link voltage outside limits", "torque or current limit exceeded")


def test_word_of_sets_the_bits_of_the_true_flags():
    vlt = control_profile("vlt3500")
    assert vlt.word_of({"running": True, "tripped": False, "control ready": True}) == 0x0801
    assert vlt.word_of({}) == 0
    assert all(vlt.flags_of(vlt.word_of({name: True})) == (name,) for name in vlt.flags.values())


def test_unlisted_drivecom_pattern_is_not_ready():
    drivecom = control_profile("drivecom")
    assert drivecom.state_of({"": 0x0002}) is None
    status = drivecom.status({"": 0x0002})
    assert (status.state, status.running, status.flags) == (DriveState.NOT_READY, False, ("unlisted state",))


@pytest.mark.parametrize(
    ("word", "running", "at_reference", "fault"),
    [
        (0x1021, True, True, False),
        (0x1022, True, True, False),
        (0x1221, True, False, False),
        (0x1422, True, False, False),
        (0x0821, False, False, True),
        (0x1028, False, False, False),
    ],
)
def test_fuji_operation_status_gives_running_at_reference_and_fault(word, running, at_reference, fault):
    status = control_profile("fuji").status({"": word})
    assert (status.running, status.at_reference, status.fault) == (running, at_reference, fault)
    assert status.remote is bool(word & 0x1000)


def test_fuji_operation_status_bits_have_their_printed_names():
    names = ("FWD", "REV", "EXT", "INT", "BRK", "NUV", "TL", "VL", "IL", "ACC", "DEC", "ALM", "RL", "BUSY")
    assert control_profile("fuji").flags_of(0x9FFF) == names
