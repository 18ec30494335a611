"""Mistakes in profiles: a profile that no drive could obey or that would be unsafe is reported."""

from dataclasses import replace

import pytest

from drivecomm.profiles import ControlStep, control_profile, mistakes_in
from drivecomm.protocol import Stop

SOUND = control_profile("drivecom")
FAULT = [each for each in SOUND.transitions if "fault" in each.origins]
OTHERS = tuple(each for each in SOUND.transitions if "fault" not in each.origins)
RUNS = ControlStep(word=0x000F, repeats=True)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"stops": {}}, "not how to stop it"),
        ({"stops": {}, "start": ()}, "stops no motor"),
        ({"stops": {Stop.RAMP: (ControlStep(word=0x0007),)}}, "would not be sent again"),
        ({"stops": {Stop.RAMP: (RUNS,)}}, "lets the motor run"),
        ({"start": (*SOUND.start[:2], RUNS)}, "may start a motor would be sent again"),
        ({"start": SOUND.start[:2]}, "the last word of start stops the motor"),
        ({"reset": (*SOUND.reset, ControlStep(word=0x000F))}, "the reset has a word that lets the motor run"),
        ({"idle": 0x000F}, "the idle word lets a motor run"),
        ({"transitions": OTHERS}, "no step leads out of a fault"),
        ({"transitions": (*OTHERS, replace(FAULT[0], rising=0))}, "a fault is left without an edge"),
        (
            {"transitions": tuple(each for each in SOUND.transitions if each.goal != "operation enabled")},
            "no step leads to a state in which the motor runs",
        ),
        ({"states": (replace(SOUND.states[0], shows=0x08), *SOUND.states[1:])}, "is shown as 'fault'"),
    ],
)
def test_mistakes_in_an_altered_profile_are_reported(changed, said):
    assert any(said in each for each in mistakes_in(replace(SOUND, **changed))), list(
        mistakes_in(replace(SOUND, **changed))
    )


def test_state_that_no_status_word_shows_is_a_mistake():
    state = replace(SOUND.states[0], known_by=replace(SOUND.states[0].known_by, values=(0x80,)))
    assert any("no status word is the state" in each for each in mistakes_in(replace(SOUND, states=(state,))))
