"""The catalogue: what a master must survive, by the task that it is given.

Each module registers cases with `case`; importing this package registers all of them, those on which others rest first.
"""

from importlib import import_module

for _name in (
    "plain",
    "on_the_line",
    "reading",
    "late_replies",
    "refusals",
    "writing",
    "starting",
    "stopping",
    "outages",
):
    import_module(f"{__name__}.{_name}")
