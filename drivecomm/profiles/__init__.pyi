from .commander import (
    Commander as Commander,
    WordTransport as WordTransport,
    check_needs as check_needs,
    signed_reference as signed_reference,
)
from .control_table import (
    CONTROL_KEYS as CONTROL_KEYS,
    ControlTable as ControlTable,
    WritePlan as WritePlan,
    control_entries as control_entries,
    references_of as references_of,
    views_of as views_of,
)
from .dialect import Access as Access, Dialect as Dialect, control_of as control_of
from .files import (
    KEYS as KEYS,
    control_profile as control_profile,
    control_profile_from as control_profile_from,
    control_profiles as control_profiles,
)
from .full_scale import FullScale as FullScale, full_scale_of as full_scale_of
from .machine import ProfileMachine as ProfileMachine, drive_motor as drive_motor
from .mistakes import mistakes_in as mistakes_in
from .plugin import register_protocol as register_protocol
from .process_words import (
    CommandMemory as CommandMemory,
    ProcessWords as ProcessWords,
    WordTelegrams as WordTelegrams,
)
from .profile import (
    SOLE_PLACE as SOLE_PLACE,
    BitCondition as BitCondition,
    ControlProfile as ControlProfile,
    ControlStep as ControlStep,
    MotorDoes as MotorDoes,
    StartRefusal as StartRefusal,
    State as State,
    StateTransition as StateTransition,
    Words as Words,
)
from .references import ReferenceConverter as ReferenceConverter
from .register_command_carrier import (
    RegisterCommandTransport as RegisterCommandTransport,
    RegisterTelegrams as RegisterTelegrams,
)
from .register_command_memory import RegisterCommandMemory as RegisterCommandMemory, stop_safely as stop_safely
from .register_command_tables import FAULT_PLACE as FAULT_PLACE
from .register_commands import RegisterCommandMachine as RegisterCommandMachine
from .register_conversation import RegisterConversation as RegisterConversation
from .register_machine import RegisterMachine as RegisterMachine, RegisterRefusal as RegisterRefusal
from .register_operations import RegisterOperations as RegisterOperations
from .registers import (
    RegisterParameter as RegisterParameter,
    RegisterPlace as RegisterPlace,
    blocks_of as blocks_of,
    span_of as span_of,
)
from .virtual_registers import VirtualRegisterDrive as VirtualRegisterDrive
