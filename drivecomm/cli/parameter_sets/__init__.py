"""The commands for parameter sets: backup, compare, restore."""
