"""The demo command: a tour of everything, on virtual lines or on a real one."""
