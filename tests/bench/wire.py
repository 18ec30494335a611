"""A port with one drive behind it, on which a test defines what arrives and when."""

from drivecomm.virtual import Station


class Wire:
    """A network port, as of a serial server, with one drive and a defined arrival of its replies.

    say: turns a request and the drive's reply into the pieces that arrive, each with its delay.
    """

    paced = False
    real_time = False
    descriptor = None

    def __init__(self, drive, say):
        self.time = 0.0
        self._station = Station(drive)
        self._say = say
        self._coming = []

    def now(self):
        return self.time

    wall_time = now

    def configure(self, _):
        return ""

    def write(self, data):
        answers = self._station.hear(data, self.time, self.time)
        pieces = self._say(data, b"".join(answer.data for answer in answers))
        self._coming += [(self.time + delay, piece) for delay, piece in pieces if piece]

    def read(self, until, at_least):
        came = b""
        while self._coming and self._coming[0][0] <= until and len(came) < at_least:
            time, piece = self._coming.pop(0)
            self.time = max(self.time, time)
            came += piece
        if len(came) < at_least:
            self.time = max(self.time, until)
        return came

    def take(self):
        return self.read(self.time, 1)

    def hold_back(self, at_least):
        pass

    def wait(self, until):
        self.time = max(self.time, until)

    def close(self):
        pass
