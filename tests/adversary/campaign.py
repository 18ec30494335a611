"""Random short scripts of command lines against a disturbed simulated plant, judged by the behaviour of its motors.

    python tests/adversary/campaign.py --scripts 500 --seed 1 --at-once 4

`--only N` repeats one script, `--keep` keeps its files. Prints each failed script line by line, and a summary at the
end.
"""

import argparse
import json
import os
import random
import selectors
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from command_lines import CommandLine, fork, load
from invariant import Judge, in_the_set
from random_scripts import SIGNALS, STOPPING, script
from simulated_plant import SimulatedPlant

BOUND_S = 40
LONGEST_WAIT_S = 6
# Longer than the longest watchdog timeout of a script.
QUIET_S = 3.2
LONGEST_RAMP_S = 8
_STEADY_S = 0.15
# If other programs delay the simulator, it answers too late, and a stop reports that it is not confirmed.
_STOP_TRIES = 3
_LOOK_S = 0.01


class Script:
    """One script, from a standing plant to a standing plant."""

    def __init__(self, seed, number):
        self.seed, self.number = seed, number
        self.chance = random.Random(f"{seed}-{number}")
        self.commands, self.happened, self.failures, self.notes = [], [], [], []
        self.did = Counter()

    def run(self):
        self.plant = SimulatedPlant(fork)
        self.began = time.monotonic()
        happens = script(self.chance, self.plant.ports)
        try:
            self._carry_out(happens)
            self._mend()
            self._wait([each for each in self.commands if each.kind != "keep"])
            self._settle()
            self._judge("with those that stay", quiet=False)
            self._end_those_that_stay()
            if any(each.kind == "keep" and each.code not in {0, 2, 5} for each in self.commands):
                self._pass(QUIET_S)
            self._settle()
            self._judge("at the end", quiet=True)
            self._compare_status()
            self._stop_everything()
        finally:
            self.plant.wake()
            self.plant.close()
        self.failures += Judge(self.commands, self.happened).of_the_processes()
        return self

    def _carry_out(self, happens):
        self.later = []
        for pause, what, how in happens:
            if how.pop("waits", False):
                self._wait_for_the_last()
            self._pass_with_what_is_due(pause)
            if what == "command":
                self._start(**how)
                continue
            if "later" in how:
                seconds, *rest = how.pop("later")
                self.later.append((time.monotonic() + seconds, *rest))
            self._disturb(what, how)
        self._pass_with_what_is_due(max([0.0, *(at - time.monotonic() for at, *_ in self.later)]))

    def _wait_for_the_last(self):
        until = time.monotonic() + LONGEST_WAIT_S
        while self.commands and self.commands[-1].running and self.commands[-1].said_at is None:
            self._pass_with_what_is_due(_LOOK_S)
            if time.monotonic() > until:
                return

    def _pass_with_what_is_due(self, seconds):
        until = time.monotonic() + seconds
        while True:
            for each in list(self.later):
                if each[0] <= time.monotonic():
                    self.later.remove(each)
                    self._disturb(*each[1:])
            left = until - time.monotonic()
            self._pass(max(0.0, min(left, _LOOK_S)))
            if left <= 0:
                return

    def _disturb(self, what, how):
        self.did[what] += 1
        if what in {"trip", "power", "fault"}:
            # A silenced plant does not answer its control door either.
            self.plant.wake()
            if "lasts" in how:
                now = self.plant.order("show")["lines"][0]["time_s"]
                how = {"text": f"{how['text']}until_s = {now + how['lasts']}\n"}
            self.plant.order(what, **how)
        else:
            getattr(self.plant, what)(**how)
        self.happened.append((time.monotonic(), what, how.get("drive", how.get("line", ""))))

    def _mend(self):
        """Restore all ports and the power of all drives."""
        self.plant.wake()
        for line in self.plant.ports:
            self.plant.come_back(line)
        for drive, state in self.plant.states().items():
            if not state["powered"]:
                self.plant.order("power", drive=drive, state="on")

    def _start(self, **how):
        if how["kind"] == "restore":
            how["value"] = in_the_set(how["drive"])
        command = CommandLine(how.pop("words"), **how)
        self.commands.append(command)
        for name, given in (("closed outputs", command.stdout != "file"), ("full disks", command.largest is not None)):
            self.did[name] += given
        return command

    def _pass(self, seconds):
        until = time.monotonic() + seconds
        while True:
            for each in self.commands:
                each.attend()
            left = until - time.monotonic()
            if left <= 0:
                return
            time.sleep(min(left, _LOOK_S))

    def _wait(self, commands):
        until = time.monotonic() + BOUND_S
        while any(each.running for each in commands):
            self._pass(_LOOK_S)
            if time.monotonic() > until:
                for each in commands:
                    if each.running:
                        self.failures.append(f"{each.name} hangs:\n{each.stack()}")
                        each.signal("SIGKILL")
                until += BOUND_S

    def _settle(self):
        """Wait until the motors' outputs are steady."""
        before, until = None, time.monotonic() + LONGEST_RAMP_S
        while (now := self.plant.states()) != before and time.monotonic() < until:
            before = now
            self._pass(_STEADY_S)

    def _judge(self, when, *, quiet):
        self.failures += [
            f"{when}: {told}" for told in Judge(self.commands, self.happened).failures(self.plant, quiet=quiet)
        ]

    def _end_those_that_stay(self):
        staying = [each for each in self.commands if each.running]
        for each in staying:
            if self.chance.random() < 0.4:
                self._wait(
                    [self._start(words=["stop", each.drive, "--plant", "plant.toml"], kind="stop", drive=each.drive)]
                )
            else:
                each.signal(self.chance.choice(SIGNALS))
        self._pass(1.0)
        for each in staying:
            # When the stop came, this command may not have started its motor yet.
            each.signal(self.chance.choice(STOPPING))
        self._wait(staying)

    def _compare_status(self):
        told = self._start(words=["status", "--plant", "plant.toml", "--json"], kind="status")
        self._wait([told])
        states = self.plant.states()
        for text in told.out.read_text().splitlines():
            of = json.loads(text)
            name = of.get("name", of.get("drive"))
            if "state" in of and name in states and (of["state"] == "running") != states[name]["running"]:
                self.failures.append(f"{told.name} says that {name} is {of['state']}: {states[name]}")

    def _stop_everything(self):
        for _ in range(_STOP_TRIES):
            stop = self._start(words=["stop", "--all", "--plant", "plant.toml"], kind="stop all")
            self._wait([stop])
            if stop.code == 0:
                break
        else:
            self.failures.append(f"{stop.name} ended with {stop.code}: {stop.complaint}")
        self._settle()
        for name, state in self.plant.states().items():
            if state["running"]:
                self.failures.append(f"{name} runs after {stop.name}")

    def story(self):
        """Return the events of the script as lines of text."""
        lines = [f"script {self.number} of seed {self.seed}:"]
        things = [(each.began, each.told_of(self.began)) for each in self.commands]
        things += [(at, f"  {at - self.began:5.2f}  {what} {whom}") for at, what, whom in self.happened]
        lines += [text for _, text in sorted(things)]
        lines += [f"    {each.name} says: {each.complaint.strip()}" for each in self.commands if each.complaint.strip()]
        return "\n".join([*lines, *(f"  FAILED {text}" for text in self.failures)])


def _work(seed, numbers, folder, results, *, keep, verbose):
    load()
    for number in numbers:
        place = folder / str(number)
        place.mkdir()
        os.chdir(place)
        os.environ["XDG_RUNTIME_DIR"] = str(place)
        one = Script(seed, number)
        try:
            one.run()
        except Exception as error:  # noqa: BLE001 - reported as a failure of the script
            one.failures.append(f"the campaign itself: {traceback.format_exc()} {error}")
        did = one.did + Counter(name for each in one.commands for _, name in each.signalled)
        did += Counter(scripts=1, commands=len(one.commands), failed=bool(one.failures))
        did += Counter(f"exit {each.code}" if not each.killed else "exit by SIGKILL" for each in one.commands)
        story = one.story() if one.failures or verbose else ""
        results.write(json.dumps([did, story]) + "\n")
        results.flush()
        if not keep:
            os.chdir(folder)
            shutil.rmtree(place)


def main():
    words = argparse.ArgumentParser()
    words.add_argument("--scripts", type=int, default=int(os.environ.get("DRIVECOMM_SCRIPTS", "16")))
    words.add_argument("--seed", default=os.environ.get("DRIVECOMM_SEED", "1"))
    words.add_argument("--at-once", type=int, default=4)
    words.add_argument("--only", type=int, action="append")
    words.add_argument("--keep", action="store_true")
    words.add_argument("--verbose", action="store_true")
    given = words.parse_args()
    for name in [name for name in os.environ if name.startswith("DRIVECOMM_")]:
        del os.environ[name]
    folder = Path(tempfile.mkdtemp(prefix="adversary-"))
    numbers = given.only or list(range(given.scripts))
    began = time.monotonic()
    workers = []
    for first in range(given.at_once):
        read, write = os.pipe()
        child = os.fork()
        if not child:
            os.close(read)
            with os.fdopen(write, "w") as results:
                _work(
                    given.seed, numbers[first :: given.at_once], folder, results, keep=given.keep, verbose=given.verbose
                )
            os._exit(0)
        os.close(write)
        workers.append((child, os.fdopen(read)))
    did = _gathered(workers)
    if given.keep:
        print(f"files are in {folder}")
    else:
        shutil.rmtree(folder, ignore_errors=True)
    counted = ", ".join(f"{name} {did[name]}" for name in sorted(did))
    print(f"seed {given.seed}, {time.monotonic() - began:.0f} s: {counted}")
    sys.exit(1 if did["failed"] or did["scripts"] != len(numbers) else 0)


def _gathered(workers):
    did = Counter()
    with selectors.DefaultSelector() as ready:
        for _, file in workers:
            ready.register(file, selectors.EVENT_READ)
        while ready.get_map():
            for key, _ in ready.select():
                text = key.fileobj.readline()
                if not text:
                    ready.unregister(key.fileobj)
                    continue
                more, story = json.loads(text)
                did.update(more)
                if story:
                    print(story, flush=True)
    for child, file in workers:
        os.waitpid(child, 0)
        file.close()
    return did


if __name__ == "__main__":
    main()
