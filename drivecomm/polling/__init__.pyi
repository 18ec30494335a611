from .loops import poll as poll, poll_async as poll_async
from .one_line import in_blocks as in_blocks, poll_bus as poll_bus
from .plan import Plan as Plan
from .schedule import (
    FIRST_ROUND_S as FIRST_ROUND_S,
    FRESH as FRESH,
    PRIORITY_STEP_S as PRIORITY_STEP_S,
    STATUS as STATUS,
    PollBlock as PollBlock,
    PollItem as PollItem,
    PollResult as PollResult,
    ResultQuality as ResultQuality,
    Schedule as Schedule,
    items_of as items_of,
)
