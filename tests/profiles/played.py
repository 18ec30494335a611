"""A drive that consists of a profile and its machine alone, on a line without bytes."""

from drivecomm.errors import NoReplyError
from drivecomm.profiles import ProfileMachine
from drivecomm.protocol import Motor, Pause


class Drive:
    """A drive that gets control words directly; time advances by the pauses of its commander.

    deaf: whether it ignores every control word. deaf_to: a control word that it ignores. lost: number of replies to
    lose from now on, after the drive has received the word. sent: the words received so far, each with whether it was
    urgent.
    """

    def __init__(self, profile, *, deaf=False, deaf_to=None, hz=50.0):
        self.profile, self.deaf, self.lost, self.now, self.sent = profile, deaf, 0, 0.0, []
        self.deaf_to = deaf_to
        self.motor = Motor(ramp_up_s=1.0, ramp_down_s=1.0, quick_ramp_s=0.2)
        self.machine = ProfileMachine(profile, self.motor, lambda word: -hz if word & profile.reverse else hz)

    def look(self):
        return self.words()
        yield

    def send(self, step, *, urgent):
        self.sent.append((step.word, urgent))
        if not self.deaf and step.word != self.deaf_to:
            self.machine.control(step.word, self.now)
        if self.lost:
            self.lost -= 1
            raise NoReplyError("no reply")
        return None
        yield

    def words(self):
        self.machine.follow(self.now)
        bits = 0
        for name, holds in (("running", self.motor.running), ("remote", True)):
            if name in self.profile.bits and holds:
                bits |= self.profile.bits[name][0].values[0]
        return {"": self.machine.status_word() | bits}

    def carry_out(self, exchange):
        """Run an exchange with the drive; return its result."""
        try:
            effect = next(exchange)
            while True:
                assert isinstance(effect, Pause)
                self.now += effect.seconds
                effect = exchange.send(None)
        except StopIteration as end:
            return end.value

    def passes(self, seconds):
        self.now += seconds
        self.machine.follow(self.now)
