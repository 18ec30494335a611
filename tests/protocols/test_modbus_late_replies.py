"""Late replies to function 10H, which name no value: they must not confirm a later command."""

from contextlib import suppress

import pytest
from wire import Wire

import drivecomm
from drivecomm.errors import NoReplyError
from drivecomm.virtual import virtual_drive

REPLY_TIMEOUT_S = 0.1
WRITES = {6, 16}


class Deaf:
    """A drive that misses the second write after counting begins."""

    def __init__(self, model):
        self.inner = virtual_drive("modbus", 5, model=model)
        self.counting, self.writes = False, 0

    def __getattr__(self, name):
        return getattr(self.inner, name)

    def hear(self, find, now):
        if self.counting and getattr(getattr(find, "message", None), "function", 0) in WRITES:
            self.writes += 1
            if self.writes == 2:
                return None
        return self.inner.hear(find, now)


def late(deaf):
    """Return a function that schedules replies: that to the first counted write comes after its caller has given up."""

    def say(request, reply):
        is_first = deaf.counting and request[1] in WRITES and deaf.writes == 1
        return [(REPLY_TIMEOUT_S + 0.1 if is_first else 0.01, reply)]

    return say


def opened(deaf):
    return drivecomm.open_bus(lambda: Wire(deaf, late(deaf)), echo="off")


@pytest.mark.parametrize(("model", "parameter"), [("fuji-frenic", "0x0007"), ("abb-acs355", "42202")])
def test_write_is_not_confirmed_by_the_late_reply_to_another(model, parameter):
    deaf = Deaf(model)
    with opened(deaf) as bus:
        drive = bus.drive("modbus", 5, model=model, reply_timeout_s=REPLY_TIMEOUT_S, attempts=1)
        drive.write(parameter, 7, store=True)
        deaf.counting = True
        with pytest.raises(NoReplyError):
            drive.write(parameter, 8, store=True)
        with pytest.raises(NoReplyError):
            drive.write(parameter, 9, store=True)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("model", "reference"),
    [
        ("danfoss-fc", {"percent": 50}),
        ("bonfiglioli", {"hz": 20}),
        ("fuji-frenic", {"hz": 20}),
        ("abb-acs355", {"percent": 50}),
    ],
)
def test_stop_is_not_confirmed_by_the_late_reply_to_a_start(model, reference):
    deaf = Deaf(model)
    with opened(deaf) as bus:
        drive = bus.drive("modbus", 5, model=model, reply_timeout_s=REPLY_TIMEOUT_S, attempts=1)
        drive.set_reference(**reference)
        deaf.counting = True
        with pytest.raises(NoReplyError):
            drive.start()
        with suppress(NoReplyError):
            drive.stop()
            # The motor ramps down.
            for _ in range(2000):
                drive.status()
            assert not drive.status().running
