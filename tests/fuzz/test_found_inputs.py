"""Inputs that once revealed a flaw are now read without an error, or refused with an error of the tree."""

import pytest
from all_targets import all_targets
from target import FOUND

KEPT = [path for path in sorted(FOUND.glob("*/*")) if path.is_file()]


def test_every_stored_input_belongs_to_a_target():
    assert {path.parent.name for path in KEPT} <= set(all_targets())


@pytest.mark.parametrize("path", KEPT, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_stored_input_reveals_no_flaw_any_more(path):
    all_targets()[path.parent.name].check(path.read_bytes())
