"""Commands for parameter sets: `backup`, `compare`, `restore`."""
