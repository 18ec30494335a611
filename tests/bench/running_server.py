"""A real server of a plant file, in a thread of the test process."""

import asyncio
import threading
from contextlib import contextmanager

from drivecomm.server import Serving

_SOON_S = 20.0


@contextmanager
def running_server(path):
    """Serve a plant file during the block, as `drivecomm serve` does; yield the plant as its doors see it."""
    serving, ready, failures, plants = Serving(path), threading.Event(), [], []

    def is_ready(plant):
        plants.append(plant)
        ready.set()

    def serve():
        try:
            asyncio.run(serving.run(is_ready))
        except BaseException as error:
            failures.append(error)
            raise
        finally:
            ready.set()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    assert ready.wait(_SOON_S), "the server does not begin"
    if failures:
        raise failures[0]
    try:
        yield plants[0]
    finally:
        serving.end()
        thread.join(_SOON_S)
        assert not thread.is_alive(), "the server does not end"
