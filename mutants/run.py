"""Trial of the conformance kit and the tests with mutants: each mutant is planted, and must be detected.

    make mutants
    python mutants/run.py [PROTOCOL | framework | THEME ...] [--only ID] [--write] [--jobs N]

The kit judges mutants of protocol packages, the tests those of the framework. Prints the check or test that killed each
mutant. The exit code is 1 if a mutant that changes behaviour survives, or one that changes nothing is killed. `--write`
writes the lists into the pages of the documentation. A theme is a file of framework/.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING

from kill_list import FRAMEWORK_PAGE, PAGE, write_sections
from mutant import FRAMEWORK, framework_mutants_of, mutants_of, protocols, themes
from planting import judged, judged_by_tests

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from mutant import Mutant
    from planting import Fate


def main() -> int:
    """Judge the chosen mutants; return the exit code."""
    packages = protocols()
    known = [*packages, FRAMEWORK, *themes()]
    parser = argparse.ArgumentParser(description="Judge the conformance kit and the tests by planted mistakes.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"only these, of {', '.join(known)}; all unless given")
    parser.add_argument("--only", metavar="ID", default="", help="the mutants with this in their id")
    parser.add_argument("--write", action="store_true", help="write the lists into the documentation")
    parser.add_argument("--jobs", type=int, metavar="N", default=os.cpu_count(), help="how many are judged at a time")
    given = parser.parse_args()
    if unknown := sorted(set(given.names) - set(known)):
        parser.error(f"there are no mutants of {unknown[0]!r}; they are of {', '.join(known)}")
    names = given.names or [*packages, FRAMEWORK]
    chosen = [name for name in packages if name in names]
    if given.write and given.only:
        parser.error("a list in the documentation is whole; give --write without --only")
    of_packages = {
        name: _hunt(name, _named(mutants_of(name), given.only), partial(judged, name), given.jobs) for name in chosen
    }
    of_framework = {
        theme: _hunt(theme, _named(framework_mutants_of(theme), given.only), judged_by_tests, given.jobs)
        for theme in themes()
        if FRAMEWORK in names or theme in names
    }
    fates = [fate for each in (*of_packages.values(), *of_framework.values()) for fate in each]
    wrong = [fate for fate in fates if fate.survived != bool(fate.mutant.same)]
    for fate in wrong:
        print(f"wrong: {fate.mutant.id}: " + ("nothing noticed it" if fate.survived else f"{fate.check} noticed it"))
    if given.write and chosen:
        write_sections(PAGE, of_packages)
    if given.write and of_framework:
        write_sections(FRAMEWORK_PAGE, of_framework)
    killed = sum(not fate.survived for fate in fates)
    print(f"{len(fates)} planted, {killed} killed, {sum(bool(fate.mutant.same) for fate in fates)} change nothing")
    return 1 if wrong else 0


def _named(mutants: Iterable[Mutant], part: str) -> list[Mutant]:
    return [mutant for mutant in mutants if part in mutant.id]


def _hunt(group: str, mutants: list[Mutant], judge: Callable[[Mutant], Fate], jobs: int) -> list[Fate]:
    # Threads suffice: each mutant is judged in a separate process.
    with ThreadPoolExecutor(jobs) as crew:
        fates = []
        for fate in crew.map(judge, mutants):
            print(f"{group:<16}{fate.mutant.id:<44}{fate.check or 'survived'}", flush=True)
            fates.append(fate)
    return fates


if __name__ == "__main__":
    sys.exit(main())
