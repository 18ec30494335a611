"""Command `stop`: one drive, or everything, with as few imports as possible."""
