from .call_styles import (
    back_up as back_up,
    back_up_async as back_up_async,
    back_up_everything as back_up_everything,
    back_up_everything_async as back_up_everything_async,
    carry_out_plan as carry_out_plan,
    carry_out_plan_async as carry_out_plan_async,
    factory_set as factory_set,
    factory_set_async as factory_set_async,
    plan_restore as plan_restore,
    plan_restore_async as plan_restore_async,
)
from .comparing import Comparison as Comparison, Difference as Difference, compare as compare
from .effect import model_of as model_of
from .everything import backup_plan as backup_plan, reading_everything as reading_everything
from .file_names import file_stem as file_stem
from .files import (
    entries_text as entries_text,
    must_be_free as must_be_free,
    read_set as read_set,
    text_of as text_of,
    write_set as write_set,
)
from .journal import (
    RestoreJournal as RestoreJournal,
    found_journal as found_journal,
    journal_path as journal_path,
    new_journal as new_journal,
)
from .parameter_set import (
    PARTS as PARTS,
    WRITABLE as WRITABLE,
    Approval as Approval,
    Explored as Explored,
    ParameterEntry as ParameterEntry,
    ParameterSet as ParameterSet,
    Part as Part,
    in_order as in_order,
    in_unit as in_unit,
    same as same,
)
from .reading_out import (
    IN_RAM as IN_RAM,
    SetSubject as SetSubject,
    no_progress as no_progress,
    of_another_drive as of_another_drive,
    part_of as part_of,
    subject as subject,
)
from .restore_plan import PlannedItem as PlannedItem, RestoreOptions as RestoreOptions, RestorePlan as RestorePlan
from .restoring import RestoreResult as RestoreResult
from .share import Share as Share, percent as percent, share_of as share_of
