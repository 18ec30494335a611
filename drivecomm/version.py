"""Version of the distribution; it is stored nowhere else."""

__version__ = "0.2.0"
