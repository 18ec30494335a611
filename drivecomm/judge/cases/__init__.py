"""Catalogue of cases that a master must survive, grouped by the master's task.

Each module registers its cases with `case`; importing this package registers all of them, basic cases first.
"""

from importlib import import_module

for _name in (
    "plain",
    "line_behaviour",
    "reading",
    "late_replies",
    "refusals",
    "writing",
    "starting",
    "stopping",
    "outages",
):
    import_module(f"{__name__}.{_name}")
