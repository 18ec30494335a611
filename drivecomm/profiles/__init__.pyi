from .commander import Carrier as Carrier, Commander as Commander
from .files import (
    KEYS as KEYS,
    control_profile as control_profile,
    control_profile_from as control_profile_from,
    control_profiles as control_profiles,
)
from .machine import ProfileMachine as ProfileMachine
from .mistakes import mistakes_in as mistakes_in
from .profile import (
    ONLY as ONLY,
    Condition as Condition,
    ControlProfile as ControlProfile,
    MotorDoes as MotorDoes,
    Refusal as Refusal,
    State as State,
    Step as Step,
    Transition as Transition,
    Words as Words,
)
