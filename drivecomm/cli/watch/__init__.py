"""Command `watch`: the drives of a plant, live in a terminal."""
