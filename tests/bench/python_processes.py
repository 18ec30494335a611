"""Tests that expect the system to call a Python program "python"."""

import sys
from pathlib import Path

import pytest

named_python = pytest.mark.skipif(
    sys.platform == "linux" and not Path("/proc/self/comm").read_text(encoding="ascii").startswith("python"),
    reason="this Python runs as a program of another name",
)
