"""The watch command: the drives of a plant, live in a terminal."""
