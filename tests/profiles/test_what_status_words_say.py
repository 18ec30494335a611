"""Status words as the manuals print them, with every value of the bits that they leave open."""

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


def words(pattern):
    """Yield a word for each value that two of three open bits can have, and the others all 0 and all 1."""
    bits = pattern.replace(" ", "")
    for fill in itertools.product("01", repeat=min(6, bits.count("x"))):
        for rest in "01":
            left = iter(reversed(fill))
            yield int("".join(next(left, rest) if bit == "x" else bit for bit in reversed(bits))[::-1], 2)


@pytest.mark.parametrize(("pattern", "name"), DRIVECOM.items())
def test_states_of_drivecom(pattern, name):
    assert {control_profile("drivecom").state_of({"": word}).name for word in words(pattern)} == {name}


@pytest.mark.parametrize(("pattern", "state"), PROFIDRIVE.items())
def test_states_of_profidrive(pattern, state):
    assert {control_profile("profidrive").status({"": word}).state for word in words(pattern)} == {state}


@pytest.mark.parametrize(("pattern", "state"), FC.items())
def test_states_of_the_fc_profile(pattern, state):
    assert {control_profile("danfoss-fc").status({"": word}).state for word in words(pattern)} == {state}


def test_a_pattern_that_no_manual_lists_is_no_state():
    drivecom = control_profile("drivecom")
    assert drivecom.state_of({"": 0x0002}) is None
    status = drivecom.status({"": 0x0002})
    assert (status.state, status.running, status.flags) == (DriveState.NOT_READY, False, ("unlisted state",))
