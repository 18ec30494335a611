"""The stop command: one drive, or everything, with as little loaded as that takes."""
