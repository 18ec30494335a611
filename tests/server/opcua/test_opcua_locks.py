"""Locks as leases: whatever becomes of the session meanwhile, none is left behind."""

from types import SimpleNamespace

from served_core import OPERATOR, awaited

from drivecomm.server.opcua.asking import Asking
from drivecomm.server.opcua.locks import DONE, REFUSED, Locks


class Plant:
    """Gives leases; meanwhile: called while one is being given."""

    def __init__(self, meanwhile):
        self.held, self._meanwhile = set(), meanwhile

    async def take_lease(self, _caller, drive, _seconds):
        self.held.add(drive)
        self._meanwhile()
        return SimpleNamespace(key="k")

    async def end_lease(self, _caller, drive, _key):
        self.held.discard(drive)


@awaited
async def test_session_that_ends_while_its_lock_is_given_leaves_none():
    session = SimpleNamespace(caller=OPERATOR, client="", over=False)
    plant = Plant(lambda: setattr(session, "over", True))
    locks = Locks(plant)
    assert await locks.init(Asking(session, 0.0), "fan") == (REFUSED, "the session is over")
    assert not plant.held
    assert not locks.key(session, "fan")


@awaited
async def test_lock_lasts_until_its_session_ends():
    session = SimpleNamespace(caller=OPERATOR, client="", over=False)
    plant = Plant(lambda: None)
    locks = Locks(plant)
    assert await locks.init(Asking(session, 0.0), "fan") == (DONE, "")
    assert (plant.held, locks.key(session, "fan")) == ({"fan"}, "k")
    await locks.session_ended(session)
    assert not plant.held
