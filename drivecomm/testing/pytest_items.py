"""The checks of a protocol as tests of pytest.

    from drivecomm.testing import conformance_tests

    test_conformance = conformance_tests("toy")

Each check becomes a test of its own, named as in the report; `-k` chooses among them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from drivecomm.protocol import installed
from drivecomm.testing.extent import FULL
from drivecomm.testing.judging import all_checks

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.testing.extent import Extent
    from drivecomm.testing.report import Check


def conformance_tests(protocol: str, extent: Extent = FULL) -> Callable[[Check], None]:
    """Return a test function that runs every check of an installed protocol as a test of its own.

    extent: how much is tried, `FULL` or `QUICK`. Raises UnknownProtocolError for a protocol that is not installed.
    """
    checks = list(all_checks(installed[protocol], extent))

    @pytest.mark.parametrize("check", checks, ids=[check.name for check in checks])
    def test_conformance(check: Check) -> None:
        check.run()

    return test_conformance
