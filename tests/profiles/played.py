"""A profile played against its own machine: a drive that is nothing but the profile, on a line without bytes."""

from drivecomm.errors import NoReplyError
from drivecomm.profiles import ProfileMachine
from drivecomm.protocol import Motor, Pause


class Drive:
    """Carries words to a machine; time passes by the pauses of whoever commands it.

    deaf, deaf_to: ignores every control word, or this one. lost: how many replies are lost from now on, after the drive
    has heard. sent: what it was sent.
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
        """Carry out what somebody does with the drive; return what came of it."""
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
