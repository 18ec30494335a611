"""Virtual drives behind real ports, for what only time that passes can show."""

from real_lines import serving

__all__ = ["serving"]
