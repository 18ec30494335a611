"""Replies equal to their request byte for byte: a value of 0, and nothing else to distinguish them."""

import pytest

import drivecomm
from drivecomm.errors import NoReplyError, RefusedError, ReplyError
from drivecomm.virtual import VirtualLine, virtual_drive

PRESENT, ABSENT = 3, 4
LINES = pytest.mark.parametrize(
    ("echoes", "mode"), [(False, "off"), (True, "off"), (False, "auto"), (True, "auto"), (True, "expect")]
)
PACED = pytest.mark.parametrize("paced", [True, False])
SETTINGS = [
    {"pkw_words": 3, "pzd_words": 0},
    {"pkw_words": 4, "pzd_words": 0},
    {"pkw_words": 127, "pzd_words": 0},
    {"pkw_words": 4, "pzd_words": 1},
    {"pkw_words": 127, "pzd_words": 2},
]


class StatusOfZero:
    """A patch of a virtual drive that makes its status word and actual value 0."""

    def __init__(self, virtual):
        self.virtual = virtual
        virtual._status_word = lambda: 0
        virtual._actual = lambda: 0


def on_a_line(echoes, paced, **options):
    virtual = virtual_drive("uss", PRESENT, **options)
    StatusOfZero(virtual)
    port = VirtualLine([virtual], echo=echoes).port()
    port.paced = paced
    return virtual, port


@PACED
@LINES
@pytest.mark.parametrize("options", SETTINGS)
@pytest.mark.parametrize("held", [0, 1, 0xFFFF])
def test_any_value_is_read_with_and_without_an_echo(echoes, mode, paced, options, held):
    virtual, port = on_a_line(echoes, paced, **options)
    virtual.poke("700", held)
    with drivecomm.open_bus(lambda: port, echo=mode) as bus:
        drive = bus.drive("uss", PRESENT, **options)
        for _ in range(2):
            assert drive.read("700").raw == held


@PACED
@LINES
@pytest.mark.parametrize("options", SETTINGS)
def test_echo_alone_is_not_taken_for_a_reply(echoes, mode, paced, options):
    _, port = on_a_line(echoes, paced, **options)
    with drivecomm.open_bus(lambda: port, echo=mode) as bus:
        for _ in range(2):
            with pytest.raises(NoReplyError):
                bus.drive("uss", ABSENT, **options).read("700")
            with pytest.raises(NoReplyError):
                bus.drive("uss", ABSENT, **options).probe()


@PACED
@LINES
def test_status_of_zero_is_read_with_and_without_an_echo(echoes, mode, paced):
    _, port = on_a_line(echoes, paced)
    with drivecomm.open_bus(lambda: port, echo=mode) as bus:
        for _ in range(2):
            assert bus.drive("uss", PRESENT).status().word == 0
            bus.drive("uss", PRESENT).call("control_word", word=0)
            with pytest.raises(NoReplyError):
                bus.drive("uss", ABSENT).status()


@PACED
@LINES
@pytest.mark.parametrize("options", SETTINGS)
def test_refusal_equal_to_its_task_is_recognised(echoes, mode, paced, options):
    """Task 7 writes an element and reply 7 refuses it: 2 is beyond the limit, which is refused with error 2."""
    _, port = on_a_line(echoes, paced, **options)
    with drivecomm.open_bus(lambda: port, echo=mode) as bus:
        drive = bus.drive("uss", PRESENT, **options)
        for _ in range(2):
            with pytest.raises(RefusedError, match="limit violated"):
                drive.write("2010[0]", 2, type="U16")
        with pytest.raises(ReplyError):
            bus.drive("uss", ABSENT, **options).write("2010[0]", 2, type="U16")


@PACED
@LINES
def test_unmistakable_reply_needs_no_second_request(echoes, mode, paced):
    virtual, port = on_a_line(echoes, paced)
    virtual.poke("700", 5)
    sent = []
    with drivecomm.open_bus(lambda: port, echo=mode, trace=lambda event: sent.append(event.what)) as bus:
        drive = bus.drive("uss", PRESENT)
        drive.read("700")
        sent.clear()
        drive.read("700")
    assert sent.count("sent") == 1
