"""Restores with the line cut at random moments and resumed: each model ends up with the bytes of the backup.

A few runs of each model are played; DRIVECOMM_RESTORE_SEEDS=1000 plays a thousand.
"""

import os
from collections import Counter
from dataclasses import replace
from random import Random

import pytest
from extents import every
from set_drives import cases_with_settings

import drivecomm
from drivecomm.commissioning.parameter_sets import (
    back_up,
    carry_out_plan,
    compare,
    entries_text,
    found_journal,
    journal_path,
    new_journal,
    plan_restore,
    read_set,
    text_of,
    write_set,
)
from drivecomm.errors import LinkError, ReplyError
from drivecomm.plant import UNDISTURBED, FaultPlan, LineFault
from drivecomm.virtual import VirtualLine

CASES = cases_with_settings()
CUTS = Counter()
"""Number of cuts by way and phase; the key `courses` counts completed runs."""
SEEDS = int(os.environ.get("DRIVECOMM_RESTORE_SEEDS", "0")) or 2 * len(CASES)


class KilledError(BaseException):
    """Sudden end of the program, as by a kill."""


class Cut:
    """Cut of a line at telegram number `after`, in one of the ways of `WAYS`."""

    WAYS = ("unplugged", "wire", "power", "killed")

    def __init__(self, line, way, after):
        self.line, self.way, self.left = line, way, after
        self.happened = False
        line.monitors.append(self)

    def __call__(self, _):
        self.left -= 1
        if self.left:
            return
        self.happened = True
        if self.way == "unplugged":
            self.line.broken = True
        elif self.way == "wire":
            self.line.faults = FaultPlan(rate=1.0, kinds=[LineFault.DROP])
        elif self.way == "power":
            self.line.power_off(self.line.drives[0])
        else:
            raise KilledError

    def mend(self):
        self.line.monitors.clear()
        self.line.broken = False
        self.line.faults = UNDISTURBED
        if not self.line.has_power(self.line.drives[0]):
            self.line.power_on(self.line.drives[0])
        self.line.advance(10.0)


def restored(case, line, path, random):
    """Restore with up to three cuts; return the addresses that were confirmed and not lost again, in order."""
    confirmed = []
    for attempt in range(5):
        cut = None
        if attempt < 3 and random.random() < (1.0, 0.5, 0.5)[attempt]:
            cut = Cut(line, random.choice(Cut.WAYS), random.randint(1, 500))
        known = read_set(path)
        at = journal_path(path, known.drive)
        try:
            with drivecomm.open_bus(line.port) as bus:
                journal = found_journal(at, known, known.drive) if attempt else new_journal(at, known, known.drive)
                before = journal.written
                drive = case.drive(bus)
                done = carry_out_plan(drive, plan_restore(drive, known), journal)
                confirmed += done.written
                assert done.complete, done.refused
                assert not at.exists()
                if cut:
                    cut.mend()
                CUTS["courses"] += 1
                return confirmed
        except (LinkError, ReplyError, KilledError):
            assert cut is not None
            assert cut.happened
            CUTS[cut.way, "while writing" if journal.written else "before"] += 1
            confirmed += journal.written - before
            held = case.held(line.drives[0])
            cut.mend()
            # Values held only in RAM are lost with the power and must be written again.
            lost = {address for address, raw in case.held(line.drives[0]).items() if raw != held[address]}
            confirmed = [address for address in confirmed if address not in lost]
    raise AssertionError


@pytest.mark.soak
@pytest.mark.parametrize("seed", every(2, range(SEEDS)), ids=lambda seed: f"{CASES[seed % len(CASES)]}-{seed}")
def test_resumed_restore_brings_back_the_same_bytes(seed, tmp_path):
    case, random, path = CASES[seed % len(CASES)], Random(seed), tmp_path / "drive.toml"
    virtual = case.new()
    assert case.change(virtual, random), "a drive as new tests nothing"
    held = case.held(virtual)
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        first = back_up(case.drive(bus))
    write_set(path, first)
    # Factory settings with some changes, as if a person had begun to set the drive up again.
    line = VirtualLine([case.new()])
    case.change(line.drives[0], random, share=0.1)
    confirmed = restored(case, line, path, random)
    with drivecomm.open_bus(line.port) as bus:
        second = back_up(case.drive(bus))
    assert case.held(line.drives[0]) == held
    assert entries_text(second) == entries_text(first) == entries_text(read_set(path))
    assert text_of(replace(second, time=None)) == text_of(replace(first, time=None))
    assert compare(first, second).same
    assert len(confirmed) == len(set(confirmed)), "nothing is written twice"


def test_interruptions_cover_all_kinds_and_phases():
    if CUTS["courses"] < SEEDS:
        pytest.skip("only some courses were played")
    assert CUTS.total() - CUTS["courses"] >= SEEDS / 4
    for way in Cut.WAYS:
        assert CUTS[way, "while writing"] >= SEEDS // 50
        assert CUTS[way, "before"]
