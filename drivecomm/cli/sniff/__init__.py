"""Command `sniff`: sources of bytes, names of parameters, and output."""
