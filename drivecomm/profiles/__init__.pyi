from .commander import Carrier as Carrier, Commander as Commander, check_needs as check_needs, taken_over as taken_over
from .control_table import (
    CONTROL_KEYS as CONTROL_KEYS,
    ControlTable as ControlTable,
    WayOfWriting as WayOfWriting,
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
from .machine import ProfileMachine as ProfileMachine, have_do as have_do
from .mistakes import mistakes_in as mistakes_in
from .order_carrier import OrderCarrier as OrderCarrier, RegisterTelegrams as RegisterTelegrams
from .order_memory import OrderMemory as OrderMemory, stop_for_sure as stop_for_sure
from .order_tables import TRIPPED as TRIPPED
from .orders import OrderMachine as OrderMachine
from .plugin import register_protocol as register_protocol
from .process_words import (
    CommandMemory as CommandMemory,
    ProcessWords as ProcessWords,
    WordTelegrams as WordTelegrams,
)
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
from .references import References as References
from .register_conversation import RegisterConversation as RegisterConversation
from .register_machine import RegisterMachine as RegisterMachine, RegisterRefusal as RegisterRefusal
from .register_operations import RegisterOperations as RegisterOperations
from .registers import Place as Place, Target as Target, blocks_of as blocks_of, span_of as span_of
from .virtual_registers import VirtualRegisterDrive as VirtualRegisterDrive
