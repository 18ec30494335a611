"""Virtual drives behind real ports, for tests that need real time."""

from real_lines import serving

__all__ = ["serving"]
