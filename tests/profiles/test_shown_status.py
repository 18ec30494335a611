"""Status bits of a virtual drive if several conditions share them."""

import pytest

from drivecomm.profiles.profile import Condition
from drivecomm.profiles.shown_status import motor_truth, own_truth, shown
from drivecomm.protocol import Command, Motor

# One number in a register, as on INVT drives: 1 forwards, 2 backwards, 3 stopped, 4 fault.
SAID = {
    "fault": Condition(mask=0x07, values=(4,)),
    "running": Condition(mask=0x07, values=(1, 2)),
    "reverse": Condition(mask=0x07, values=(2,)),
    "ready": Condition(mask=0x07, values=(3,)),
}


@pytest.mark.parametrize(
    ("motor", "word"),
    [
        (Motor(), 3),
        (Motor(command=Command.RUN, output_hz=20, target_hz=20), 1),
        (Motor(command=Command.RUN, output_hz=-20, target_hz=-20), 2),
        (Motor(fault=7, output_hz=0.0), 4),
    ],
    ids=["ready", "forwards", "backwards", "fault"],
)
@pytest.mark.parametrize("order", [list(SAID), list(reversed(SAID))], ids=["as given", "reversed"])
def test_more_specific_state_wins_if_two_share_bits(motor, word, order):
    said = {name: SAID[name] for name in order}
    assert shown({"": 0}, said, {**own_truth(motor), **motor_truth(motor)}) == {"": word}
    assert shown({"": 0}, said, {**motor_truth(motor), **own_truth(motor)}) == {"": word}


@pytest.mark.parametrize(
    ("output_hz", "target_hz", "bits"), [(20, 20, 0b00), (20, -20, 0b10), (-20, -20, 0b11), (-20, 20, 0b01)]
)
def test_ordered_and_actual_direction_are_shown_separately(output_hz, target_hz, bits):
    said = {
        "reverse_ordered": Condition(mask=0b10, values=(0b10,)),
        "reverse": Condition(mask=0b11, values=(0b11, 0b01)),
    }
    motor = Motor(command=Command.RUN, output_hz=output_hz, target_hz=target_hz)
    assert shown({"": 0}, said, own_truth(motor)) == {"": bits}
