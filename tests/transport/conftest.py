"""Virtual drives behind real ports, and terminals; no test leaves anything behind."""

from contextlib import closing

import pytest
from peers import Terminal
from real_lines import example, examples, nothing_left_behind, serving

__all__ = ["example", "examples", "nothing_left_behind", "serving"]


@pytest.fixture
def terminal():
    """The name of a pseudo-terminal that nobody serves."""
    with closing(Terminal()) as made:
        yield made.url
