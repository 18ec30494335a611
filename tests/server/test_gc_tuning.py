"""Python's garbage collection stops all lines, so a server keeps it short; tested in separate processes."""

import subprocess
import sys

import pytest

BEGIN = """
import gc
from drivecomm.server.gc_tuning import keep_searches_short, search_everything

much = [[] for _ in range(1_000_000)]
"""


def ran(program):
    done = subprocess.run([sys.executable, "-c", BEGIN + program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [int(word) for word in done.stdout.split()]


@pytest.mark.soak
def test_objects_in_use_after_a_long_collection_are_frozen():
    first, second = ran("""
keep_searches_short()
gc.collect()
print(gc.get_freeze_count())
gc.collect()
print(len(gc.get_objects()))
""")
    assert first > 1_000_000
    assert second < 10_000


@pytest.mark.soak
def test_short_collection_freezes_nothing():
    assert ran("""
from drivecomm.server import gc_tuning

gc_tuning._LONG_S = 60.0
keep_searches_short()
gc.collect()
print(gc.get_freeze_count())
""") == [0]


@pytest.mark.soak
def test_full_search_frees_frozen_garbage():
    assert ran("""
import weakref

class Old:
    pass

keep_searches_short()
old = Old()
old.itself = old
seen = weakref.ref(old)
gc.collect()
del old
gc.collect()
kept = seen() is not None
search_everything()
gc.collect()
print(int(kept), int(seen() is not None))
""") == [1, 0]


@pytest.mark.soak
def test_objects_frozen_by_the_process_itself_stay_frozen():
    (count,) = ran("""
gc.freeze()
search_everything()
print(gc.get_freeze_count())
""")
    assert count > 1_000_000
