import sys
from pathlib import Path

import pytest

from drivecomm.judge import Judge, JudgeOrder, JudgeTask
from drivecomm.protocol import parse_drive

MASTERS = Path(__file__).parent / "masters"
VABUS = (sys.executable, str(MASTERS / "vabus_master.py"), "{port}")
TASKS = {
    "read": JudgeTask(name="read", arguments=("read", "480")),
    "read two": JudgeTask(name="read", arguments=("read", "480", "481")),
    "write": JudgeTask(name="write", arguments=("write", "480", "12.5")),
    "start": JudgeTask(name="start", arguments=("start",)),
    "stop": JudgeTask(name="stop", arguments=("stop",)),
    "reset": JudgeTask(name="reset", arguments=("reset",)),
    "poll": JudgeTask(name="read", arguments=("poll", "480")),
    "keep": JudgeTask(name="run", arguments=("keep",)),
}


def order(*tasks, mistake="", drive="vabus:1,model=agile", command=VABUS, **further):
    named = tuple(TASKS[each] if isinstance(each, str) else each for each in tasks)
    environment = {"MISTAKE": mistake}
    return JudgeOrder(drive=parse_drive(drive), command=command, tasks=named, environment=environment, **further)


@pytest.fixture
def verdicts():
    """Return a function that judges the small master, with or without mistakes; it returns the verdicts by case."""

    def judged(*tasks, cases=(), **further):
        judge = Judge(order(*tasks, **further), names=cases)
        return {verdict.case: verdict for verdict in judge.verdicts()}

    return judged
