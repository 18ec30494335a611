"""Invariant of the campaign: the permitted states of the plant, given the commands and how they ended.

A motor may run after a confirmed start with hold, after such a start with an unknown outcome, and while a start that
keeps it is alive. It must not run after a later confirmed stop, trip or power cut. No command exits with 0 unless it
had its effect.
"""

import signal
import tomllib
from pathlib import Path

from simulated_plant import DRIVES, WRITABLE

NOT_SENT = 2
INTERRUPTED = {129, 130, 143}
CODES = {0, 1, 2, 3, 4, 5, *INTERRUPTED}
NOT_READ = 141
# Time for loading on a busy machine.
_LOADS_S = 10.0
_FORKS_S = 1.0
REFUSED = ("received a stop, because its start was interrupted",)
HZ_FOR_PERCENT = 0.5


class Judge:
    """Judge of commands and other events (time, kind, drive or line) against the state of the plant."""

    def __init__(self, commands, happened):
        self.commands = commands
        self.happened = happened

    def failures(self, plant, *, quiet):
        """Return violations as sentences. quiet: all watchdogs have had time to act."""
        found = []
        for name, state in plant.states().items():
            if state["running"]:
                if not self._may_run(name, quiet=quiet):
                    found.append(f"{name} runs at {state['output_hz']} Hz, and nothing lets it")
                found += self._at_another_reference(name, state)
            else:
                found += self._should_run(name)
            found += self._not_held(name, plant)
        return found

    def of_the_processes(self):
        for command in self.commands:
            told = command.complaint
            if self._may_end_by_a_signal(command):
                continue
            if "Traceback" in told or "Exception ignored" in told or "Fatal Python" in told:
                yield f"{command.name} shows a traceback"
            if command.code == NOT_READ and command.stdout in {"gone", "leaves"}:
                continue
            if command.code not in CODES and not command.killed:
                yield f"{command.name} ended with {command.code}"

    def _may_end_by_a_signal(self, command):
        """Whether the signal came before the program's first line could run, or was a repetition."""
        for number, (at, name) in enumerate(command.signalled):
            early = at - command.began < (_LOADS_S if command.spawned else _FORKS_S)
            if command.code == -signal.Signals[name] and (early or number):
                return True
        return False

    def _of(self, drive, *kinds):
        return [each for each in self.commands if each.drive == drive and each.kind in kinds]

    def _stops(self, drive):
        """Yield the start times of successful stops, and the times of power cuts and trips."""
        yield from (at for at, what, whom in self.happened if what in {"trip", "power"} and whom == drive)
        for each in self.commands:
            if each.kind == "stop all" or (each.kind == "stop" and each.drive == drive):
                if each.code == 0:
                    yield each.began
            elif each.kind == "keep" and each.drive == drive and each.code in {0, *INTERRUPTED} and each.said_at:
                yield each.signalled[0][0] if each.signalled else each.began

    def _may_run(self, drive, *, quiet):
        stops = list(self._stops(drive))
        for each in self._of(drive, "start", "keep"):
            if each.code == NOT_SENT or any(words in each.complaint for words in REFUSED):
                continue
            if each.kind == "keep":
                done = each.said_at
                if not each.running and (quiet or each.code in {0, *INTERRUPTED}):
                    continue
            else:
                done = each.ended
            if done is None or not any(stop >= done for stop in stops):
                return True
        return False

    def _touched(self, drive, since, *kinds):
        """Whether a command of these kinds, a trip or a power cut affected a drive after a time."""
        protocol = DRIVES[drive][1].partition(":")[0]
        for each in self.commands:
            at_it = each.drive == drive or each.kind == "stop all"
            at_it = at_it or (
                each.kind == "stop protocol"
                and (DRIVES[each.drive][0], DRIVES[each.drive][1].partition(":")[0]) == (DRIVES[drive][0], protocol)
            )
            if at_it and each.kind in kinds and (each.ended is None or each.ended > since):
                return True
        return any(at > since and whom in {drive, ""} for at, what, whom in self.happened if what in {"trip", "power"})

    def _should_run(self, drive):
        for each in self._of(drive, "start"):
            if (
                each.code == 0
                and not self._of(drive, "keep", "restore")
                and not self._touched(drive, each.began, "stop", "stop all", "stop protocol")
                and not any(self._overlaps(each, other) for other in self._of(drive, "start", "reset"))
            ):
                yield f"{drive} does not run, and {each.name} said that it started it"

    def _overlaps(self, one, other):
        """Whether another command ended without success during this one or later."""
        return other is not one and other.ended is not None and other.ended > one.began and other.code != 0

    def _at_another_reference(self, drive, state):
        setting = self._of(drive, "start", "reference", "keep")
        done = [each for each in setting if each.code == 0]
        if not done:
            return
        last = max(done, key=lambda each: each.ended)
        others = [
            each for each in self._of(drive, "write", "restore", *{"keep"}) if each.ended and each.ended > last.began
        ]
        if others or any(each is not last and (each.ended is None or each.ended > last.began) for each in setting):
            return
        if any(at > last.began and whom == drive for at, _, whom in self.happened):
            return
        wanted = last.told["percent"] * HZ_FOR_PERCENT
        if abs(abs(state["output_hz"]) - wanted) > 0.5:
            yield f"{drive} runs at {state['output_hz']} Hz, and {last.name} set {wanted} Hz"

    def _not_held(self, drive, plant):
        done = [each for each in self._of(drive, "write", "restore") if each.code == 0]
        if not done:
            return
        last = max(done, key=lambda each: each.ended)
        others = [each for each in self._of(drive, "write", "restore") if each is not last]
        if last.kind == "restore":
            # A backup may have replaced the file while it was being read.
            others += self._of(drive, "backup")
        if any(each.ended is None or each.ended > last.began for each in others):
            return
        if any(at > last.began and whom == drive for at, what, whom in self.happened if what == "power"):
            return
        wanted = last.told["value"]
        if wanted is not None and plant.value(drive) != wanted:
            yield f"{drive} holds {plant.value(drive)}, and {last.name} said that it wrote {wanted}"


def in_the_set(drive):
    """Return the value of the writable parameter in the drive's parameter set, or None."""
    parameter = WRITABLE[DRIVES[drive][1].partition(":")[0]][0]
    try:
        settings = tomllib.loads(Path(f"{drive}.toml").read_text())["settings"]
    except (OSError, ValueError, KeyError):
        # The file is missing or incomplete.
        return None
    each = settings.get(parameter) or settings.get(f"{parameter}[1]")
    return None if each is None else each["value"]
