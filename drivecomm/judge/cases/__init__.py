"""The catalogue: what a master must survive, by the task that it is given.

Each module registers cases with `case`; importing this package registers all of them.
"""

from drivecomm.judge.cases import (
    late_replies,
    on_the_line,
    outages,
    plain,
    reading,
    refusals,
    starting,
    stopping,
    writing,
)

__all__ = ["late_replies", "on_the_line", "outages", "plain", "reading", "refusals", "starting", "stopping", "writing"]
