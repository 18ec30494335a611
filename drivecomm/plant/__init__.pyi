from .editing import write_options as write_options
from .files import read_plant as read_plant
from .line_faults import (
    TRANSMISSION_FAULTS as TRANSMISSION_FAULTS,
    UNDISTURBED as UNDISTURBED,
    FaultPlan as FaultPlan,
    LineFault as LineFault,
    PowerCut as PowerCut,
    disturbed as disturbed,
)
from .opened import OpenPlant as OpenPlant, open_plant as open_plant
from .plant import Plant as Plant, PlantLine as PlantLine
from .poll_check import (
    notes_of_polls as notes_of_polls,
    read_served_plant as read_served_plant,
    unreadable_polls as unreadable_polls,
    with_usual_polls as with_usual_polls,
)
from .salvage import salvaged as salvaged
from .scanned import (
    ScannedLine as ScannedLine,
    add_scanned as add_scanned,
    scanned_plant as scanned_plant,
    scanned_text as scanned_text,
)
from .script import (
    FaultWindow as FaultWindow,
    InjectStep as InjectStep,
    LineNoise as LineNoise,
    Of as Of,
    PowerCutStep as PowerCutStep,
    ScriptStep as ScriptStep,
    StuckStep as StuckStep,
    TelegramFault as TelegramFault,
    TripCondition as TripCondition,
    TripStep as TripStep,
    kind_named as kind_named,
)
from .script_files import Faults as Faults, bytes_of as bytes_of, read_fault as read_fault, script_of as script_of
from .served import (
    async_bus_of_server as async_bus_of_server,
    bus_of_server as bus_of_server,
    drives_of as drives_of,
)
from .status import DriveReport as DriveReport, plant_status as plant_status
from .tag_editing import write_tags as write_tags
from .tag_table import (
    TAG_COLUMNS as TAG_COLUMNS,
    ImportedTags as ImportedTags,
    imported_tags as imported_tags,
    model_of as model_of,
    tag_cells as tag_cells,
)
from .thinning import SpanOutline as SpanOutline
from .writing import plant_text as plant_text
