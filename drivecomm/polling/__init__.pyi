from .loops import poll as poll, poll_async as poll_async, poll_bus as poll_bus
from .plan import (
    LONGEST_DELAY_S as LONGEST_DELAY_S,
    Plan as Plan,
    PlannedDrive as PlannedDrive,
    PlannedRead as PlannedRead,
)
from .plan_files import plan_in as plan_in, read_plan as read_plan
from .schedule import (
    FIRST_ROUND_S as FIRST_ROUND_S,
    PRIORITY_STEP_S as PRIORITY_STEP_S,
    PollItem as PollItem,
    PollResult as PollResult,
    Quality as Quality,
    Schedule as Schedule,
)
