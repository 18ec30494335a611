"""Judge the conformance kit by its mutants: each is planted, and the kit has to notice.

    make mutants
    python mutants/run.py [PROTOCOL ...] [--only ID] [--write]

Prints what killed each mutant. Exit code 1 when one survives that changes behaviour, or one does not that changes
nothing. `--write` puts the list into the page of the documentation.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from kill_list import write_page
from mutant import mutants_of, protocols
from planting import judged

if TYPE_CHECKING:
    from planting import Fate


def main() -> int:
    """Judge them; return the exit code."""
    known = protocols()
    parser = argparse.ArgumentParser(description="Judge the conformance kit by planted mistakes.")
    parser.add_argument("names", nargs="*", metavar="PROTOCOL", help="only these; all unless given")
    parser.add_argument("--only", metavar="ID", default="", help="the mutants with this in their id")
    parser.add_argument("--write", action="store_true", help="write the list into docs/mutants.md")
    given = parser.parse_args()
    if unknown := sorted(set(given.names) - set(known)):
        parser.error(f"there are no mutants of {unknown[0]!r}; they are of {', '.join(known)}")
    if given.write and (given.names or given.only):
        parser.error("the list in the documentation is of all mutants; give --write alone")
    fates = {protocol: _hunt(protocol, given.only) for protocol in given.names or known}
    wrong = [fate for each in fates.values() for fate in each if fate.survived != bool(fate.mutant.same)]
    for fate in wrong:
        print(f"wrong: {fate.mutant.id}: " + ("nothing noticed it" if fate.survived else f"{fate.check} noticed it"))
    if given.write:
        write_page(fates)
    return 1 if wrong else 0


def _hunt(protocol: str, only: str) -> list[Fate]:
    chosen = [mutant for mutant in mutants_of(protocol) if only in mutant.id]
    # Each is judged in a process of its own; the threads only wait for them.
    with ThreadPoolExecutor(os.cpu_count()) as crew:
        fates = []
        for fate in crew.map(lambda mutant: judged(protocol, mutant), chosen):
            print(f"{protocol:<12}{fate.mutant.id:<44}{fate.check or 'survived'}", flush=True)
            fates.append(fate)
    return fates


if __name__ == "__main__":
    sys.exit(main())
