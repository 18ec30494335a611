"""Virtual drives behind real ports; no test leaves anything behind."""

from real_lines import example, examples, nothing_left_behind, serving

__all__ = ["example", "examples", "nothing_left_behind", "serving"]
