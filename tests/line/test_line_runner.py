"""The runner of link steps on a readable port, alone."""

from drivecomm.line.runner import LineRunner
from drivecomm.link import Receive, Talk


class Talkative:
    """A port that receives data without end."""

    def now(self):
        return 1.0

    def take(self):
        return b"x" * 3000

    def read(self, _until, _at_least):
        return b"last"


def test_endless_data_between_two_exchanges_is_discarded():
    ended = []
    runner = LineRunner(Talkative(), ended.append, ended.append, lambda *came: ended.append(came), ended.append)
    for _ in range(50):
        runner.readable()

    def steps():
        return (yield Receive(1.0)).data

    runner.begin(steps(), lambda: False)
    ((data, error),) = ended
    assert error is None
    assert 1000 < len(data) < 10_000
    assert data.endswith(b"last")


def test_nothing_is_sent_while_unrequested_data_arrives():
    ended = []
    talk = Talk()
    talk.data = b"request"
    runner = LineRunner(Talkative(), ended.append, ended.append, lambda *came: ended.append(came), ended.append)

    def steps():
        return (yield talk).data

    runner.begin(steps(), lambda: False)
    assert ended == [(b"last", None)]
    assert talk.begun is None


class Looked:
    """A port with its own clock that counts its reads."""

    def __init__(self):
        self.clock, self.looks, self.sent = 0.0, 0, []

    def now(self):
        return self.clock

    def take(self):
        return b"reply"

    def read(self, _until, _at_least):
        self.looks += 1
        return b""

    def write(self, data):
        self.sent.append(data)

    def hold_back(self, _at_least):
        pass


def two_requests(pause_s):
    """Send two requests, the second `pause_s` after the first reply; return the number of reads before the second."""
    port, talk = Looked(), Talk()
    talk.data, talk.at_least, talk.reply_s = b"request", 5, 1.0
    runner = LineRunner(port, lambda _: None, lambda _: None, lambda *_: None, lambda _: None)

    def steps():
        yield talk
        port.clock += pause_s
        yield talk

    runner.begin(steps(), lambda: False)
    before = port.looks
    port.clock += 0.01
    runner.readable()
    assert port.sent == [b"request"] * 2
    return port.looks - before


def test_port_emptied_just_before_is_not_read_again():
    assert two_requests(0.00007) == 0


def test_port_emptied_a_character_ago_is_read_again():
    assert two_requests(0.00009) == 1
