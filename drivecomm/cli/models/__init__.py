"""Commands for drive models."""
