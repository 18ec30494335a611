"""Virtual lines served in a thread beside a test."""

from contextlib import closing, contextmanager

from drivecomm.testing import ServingThread


@contextmanager
def served_in_thread(server):
    """Serve in a thread until the block ends; yield the server. Serving errors are raised at the end of the block."""
    with closing(ServingThread(server)):
        yield server
