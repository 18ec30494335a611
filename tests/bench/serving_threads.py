"""Virtual lines that are served beside a test."""

from contextlib import closing, contextmanager

from drivecomm.testing import ServingThread


@contextmanager
def served_in_thread(server):
    """Serve in a thread until the block ends, which fails if serving has failed; gives the server."""
    with closing(ServingThread(server)):
        yield server
