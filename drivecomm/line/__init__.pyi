from .engine_line import EngineLine as EngineLine
from .job import Job as Job
from .line_engine import Engine as Engine
from .own_thread import in_own_thread as in_own_thread
from .owner import LineOwner as LineOwner
from .plan import PollPlan as PollPlan
from .poll_items import (
    FRESH as FRESH,
    STATUS as STATUS,
    PollBlock as PollBlock,
    PollItem as PollItem,
    PollResult as PollResult,
    ResultQuality as ResultQuality,
    items_of as items_of,
)
from .poll_loops import poll as poll, poll_async as poll_async, poll_bus as poll_bus
from .polling import in_blocks as in_blocks
from .queue import (
    TURNS_PER_POLL as TURNS_PER_POLL,
    TURNS_PER_SURVEY as TURNS_PER_SURVEY,
    LineQueue as LineQueue,
    QueueEntry as QueueEntry,
    Rank as Rank,
    line_was_busy as line_was_busy,
)
from .runner import LineRunner as LineRunner
from .schedule import FIRST_ROUND_S as FIRST_ROUND_S, PRIORITY_STEP_S as PRIORITY_STEP_S, Schedule as Schedule
from .stopping import StopAttempts as StopAttempts
from .task_hosts import (
    OwnThreadHost as OwnThreadHost,
    ReadinessHost as ReadinessHost,
    TaskHost as TaskHost,
    VirtualTimeHost as VirtualTimeHost,
    task_host_for as task_host_for,
)
from .task_line import TaskLine as TaskLine
from .task_turns import TaskTurn as TaskTurn, TaskTurns as TaskTurns
from .thread_host import run_steps as run_steps
from .thread_line import ThreadLine as ThreadLine
from .thread_turns import LOOK_S as LOOK_S, ThreadTurn as ThreadTurn, ThreadTurns as ThreadTurns
from .uncancelled import result_of as result_of
