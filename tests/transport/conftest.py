"""Virtual drives behind real ports, and terminals; no test leaves processes or open files behind."""

from contextlib import closing

import pytest
from peers import Terminal
from real_lines import example, examples, nothing_left_behind, serving

__all__ = ["example", "examples", "nothing_left_behind", "serving"]


@pytest.fixture
def terminal():
    """Yield the name of a pseudo-terminal that no program serves."""
    with closing(Terminal()) as made:
        yield made.url
