"""Parameter sets: back up a drive, compare, restore; docs/how-to/parameter-sets.md tells how."""

from drivecomm.parameter_sets.comparing import Comparison as Comparison
from drivecomm.parameter_sets.comparing import Difference as Difference
from drivecomm.parameter_sets.comparing import compare as compare
from drivecomm.parameter_sets.faces import back_up as back_up
from drivecomm.parameter_sets.faces import back_up_async as back_up_async
from drivecomm.parameter_sets.faces import carry_out_plan as carry_out_plan
from drivecomm.parameter_sets.faces import carry_out_plan_async as carry_out_plan_async
from drivecomm.parameter_sets.faces import factory_set as factory_set
from drivecomm.parameter_sets.faces import factory_set_async as factory_set_async
from drivecomm.parameter_sets.faces import plan_restore as plan_restore
from drivecomm.parameter_sets.faces import plan_restore_async as plan_restore_async
from drivecomm.parameter_sets.files import entries_text as entries_text
from drivecomm.parameter_sets.files import read_set as read_set
from drivecomm.parameter_sets.files import text_of as text_of
from drivecomm.parameter_sets.files import write_set as write_set
from drivecomm.parameter_sets.journal import Journal as Journal
from drivecomm.parameter_sets.journal import found_journal as found_journal
from drivecomm.parameter_sets.journal import journal_path as journal_path
from drivecomm.parameter_sets.journal import new_journal as new_journal
from drivecomm.parameter_sets.parameter_set import Entry as Entry
from drivecomm.parameter_sets.parameter_set import ParameterSet as ParameterSet
from drivecomm.parameter_sets.parameter_set import Part as Part
from drivecomm.parameter_sets.planning import Plan as Plan
from drivecomm.parameter_sets.planning import Planned as Planned
from drivecomm.parameter_sets.restoring import Restored as Restored
from drivecomm.parameter_sets.wishes import Wishes as Wishes
