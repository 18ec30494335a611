"""Version of the distribution; it is stored nowhere else."""

__version__ = "0.1.0"
