"""What carries out the steps of a link while its port becomes readable, alone."""

from drivecomm.link import Receive, Talk
from drivecomm.transport.line_runner import LineRunner


class Talkative:
    """A port on which somebody talks without end."""

    def now(self):
        return 1.0

    def take(self):
        return b"x" * 3000

    def read(self, _until, _at_least):
        return b"last"


def test_who_talks_without_end_between_two_exchanges_is_not_kept():
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


def test_nothing_is_sent_onto_what_somebody_says_unasked():
    ended = []
    talk = Talk()
    talk.data = b"request"
    runner = LineRunner(Talkative(), ended.append, ended.append, lambda *came: ended.append(came), ended.append)

    def steps():
        return (yield talk).data

    runner.begin(steps(), lambda: False)
    assert ended == [(b"last", None)]
    assert talk.begun is None
