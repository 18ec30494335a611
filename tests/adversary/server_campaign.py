"""Random scripts over a disturbed server with all its doors, judged by the behaviour of the motors.

    python tests/adversary/server_campaign.py --seed 1 --scripts 2000 --at-once 2
    python tests/adversary/server_campaign.py --seed 1 --script 17
    python tests/adversary/server_campaign.py --seed 1 --scripts 300 --plant forgets_unconfirmed_stops

Each script has its own server, with a clock that passes as fast as its work is done. Prints each failed script,
shortened as far as it still fails, and a summary at the end. `--plant` plants a mistake first; then a failed script is
the success.
"""

import argparse
import gc
import json
import logging
import os
import random
import signal
import sys
import time
import traceback
from collections import Counter
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import compressed_time
import forked_scripts as forked
import planted_mistakes
from server_bench import ALL_DOORS, ServerBench, in_this_loop
from server_scripts import Script
from server_steps import random_steps

WITHOUT_OPCUA = tuple(kind for kind in ALL_DOORS if kind != "opcua")
OPCUA_EVERY = 100
"""One in this many scripts includes OPC UA, whose address space takes as long to build as five scripts."""
LONGEST_S = 60.0
"""Limit in real seconds; a script that takes longer is reported as hanging."""
_SHORTENED_S = 60.0
"""Limit in seconds for shortening a failed script."""


def script_of(seed, number):
    """Return the doors and the steps of a script."""
    chance = random.Random(f"{seed}-{number}")
    kinds = ALL_DOORS if number % OPCUA_EVERY == 0 else WITHOUT_OPCUA
    return kinds, random_steps(chance, kinds)


async def _played(folder, clocks, kinds, steps):
    bench = ServerBench(folder, clocks, kinds)
    await bench.open()
    script = Script(bench)
    try:
        await script.open()
        await script.play(steps)
        await script.settle()
        return list(script.judge().failures()), _story(script.book, bench)
    finally:
        await script.close()
        await bench.close()


def play(kinds, steps, chance="", mistake=""):
    """Play a script in a separate process with its own clock; return the violations, and the story.

    chance: random seed. mistake: planted first.
    """
    try:
        return forked.result_of(lambda: _play(kinds, steps, chance, mistake), LONGEST_S)
    except RuntimeError as error:
        return [f"the campaign itself: {error}"], ""


def _play(kinds, steps, chance, mistake):
    gc.disable()
    # A SIGHUP for the server must not end this process while no server runs.
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    if mistake:
        planted_mistakes.plant(mistake)
    clocks = compressed_time.Clocks(chance)
    with in_this_loop() as folder:
        try:
            return compressed_time.run(clocks, _played(folder, clocks, kinds, steps))
        except Exception:  # noqa: BLE001 - reported as a failure of the script
            return [f"the campaign itself: {traceback.format_exc()}"], ""


def shortened(kinds, steps, chance):
    """Return fewer steps that still fail."""
    until = time.perf_counter() + _SHORTENED_S
    place = 0
    while place < len(steps) and time.perf_counter() < until:
        fewer = steps[:place] + steps[place + 1 :]
        if fewer and play(kinds, fewer, chance)[0]:
            steps = fewer
        else:
            place += 1
    return steps


def _story(book, bench):
    began = 1000.0
    lines = [(each.at, f"start of {each.drive} over {each.door}: {each.outcome or '?'}") for each in book.starts]
    lines += [
        (each.at, f"stop of {each.drive or 'all'} over {each.door}: {each.outcome or '?'}") for each in book.stops
    ]
    lines += [
        (each.at, f"{each.kind} of {each.line or each.drive} for {each.until - each.at:.1f} s")
        for each in book.troubles
    ]
    lines += [(at, f"the server is {how}") for at, how, _ in book.deaths]
    lines += [(each.at, f"{each.drive} changes in the plant file") for each in book.removals]
    for drive, seen in bench.plant.truth.items():
        before = False
        for each in seen:
            if each.running is not before:
                before = each.running
                lines.append((each.at, f"    {drive} {'runs' if before else 'stands'}"))
    lines.sort(key=lambda each: each[0])
    return "\n".join(f"  {at - began:7.2f} {text}" for at, text in lines)


def told(seed, number, kinds, steps, failures):
    """Return the report of a failed script."""
    chance = f"{seed}-{number}"
    fewer = shortened(kinds, steps, chance)
    again, story = play(kinds, fewer, chance)
    shown = [f"    [{pause}, {what!r}, {how!r}]," for pause, what, how in fewer]
    text = [f"script {number} of seed {seed} fails; {len(fewer)} of its {len(steps)} steps are enough:", *shown, story]
    return "\n".join([*text, *(f"  FAILED {each}" for each in again or failures)])


def _work(given, numbers, results):
    logging.disable(logging.CRITICAL)
    for number in numbers:
        kinds, steps = script_of(given.seed, number)
        steps = [each for each in steps if each[1] not in given.without]
        chance = f"{given.seed}-{number}"
        failures, story = play(kinds, steps, chance, given.plant)
        if failures and given.plant and play(kinds, steps, chance)[0]:
            # The script also fails without the mistake.
            failures = []
        did = Counter(what for _, what, _ in steps)
        did.update({"scripts": 1, "failed": bool(failures)})
        text = ""
        if failures:
            text = f"script {number}: {failures}" if given.plain else told(given.seed, number, kinds, steps, failures)
        elif given.verbose:
            text = f"script {number}\n{story}"
        results.write(json.dumps([did, text, number]) + "\n")
        results.flush()
        if failures and given.until_found:
            break


def _warm_up():
    """Load everything that scripts need before forking their processes."""
    logging.disable(logging.CRITICAL)
    _play(WITHOUT_OPCUA, [], "warm", "")
    gc.collect()
    gc.freeze()


def main():
    words = argparse.ArgumentParser()
    words.add_argument("--scripts", type=int, default=100)
    words.add_argument("--seed", default="1")
    words.add_argument("--script", type=int, action="append")
    words.add_argument("--at-once", type=int, default=os.cpu_count())
    words.add_argument("--plant", default="")
    words.add_argument("--until-found", action="store_true", help="end with the first script that fails")
    words.add_argument("--without", action="append", default=[], metavar="STEP", help="leave these steps out")
    words.add_argument("--plain", action="store_true", help="shorten nothing")
    words.add_argument("--verbose", action="store_true")
    given = words.parse_args()
    numbers = given.script or list(range(given.scripts))
    began = time.perf_counter()
    did = Counter()
    _warm_up()
    at_once = min(given.at_once, len(numbers))
    # An interrupted run still prints its summary.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with suppress(KeyboardInterrupt):
        for text in forked.workers(at_once, lambda first, file: _work(given, numbers[first::at_once], file)):
            more, story, _ = json.loads(text)
            did.update(more)
            if story:
                print(story, flush=True)
    print(
        f"seed {given.seed}, {time.perf_counter() - began:.0f} s: "
        + ", ".join(f"{name} {did[name]}" for name in sorted(did))
    )
    complete = did["scripts"] == len(numbers) or given.until_found
    sys.exit(1 if did["failed"] or not complete else 0)


if __name__ == "__main__":
    main()
