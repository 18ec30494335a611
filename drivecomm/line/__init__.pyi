from .job import Job as Job
from .queue import (
    TURNS_PER_POLL as TURNS_PER_POLL,
    TURNS_PER_SURVEY as TURNS_PER_SURVEY,
    LineQueue as LineQueue,
    Place as Place,
    Rank as Rank,
    line_was_busy as line_was_busy,
)
from .stopping import StopAttempts as StopAttempts
from .task_turns import TaskTurn as TaskTurn, TaskTurns as TaskTurns
from .thread_turns import LOOK_S as LOOK_S, ThreadTurn as ThreadTurn, ThreadTurns as ThreadTurns
