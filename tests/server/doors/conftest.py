"""One plant with all doors, and their clients, shared by the tests of a module."""

import pytest
from door_clients import HANDS
from every_door import hall_of


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    folder = tmp_path_factory.mktemp("every door")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STATE_DIRECTORY", str(folder / "state"))
        (folder / "state").mkdir()
        with hall_of(folder) as found:
            yield found


@pytest.fixture(scope="module")
def hands(hall):
    """Yield a client of each door, by the door's kind."""
    made = {}
    try:
        for kind, hand in HANDS.items():
            made[kind] = hand(hall)
        yield made
    finally:
        for hand in made.values():
            hand.close()


@pytest.fixture
def at_rest(hall, hands):
    """Yield the plant with motors at rest, no leases and empty records; restore that state afterwards."""
    hall.rest()
    yield hall
    for hand in hands.values():
        hand.let_go()
    hall.rest()
