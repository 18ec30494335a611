"""The commands for drive models."""
