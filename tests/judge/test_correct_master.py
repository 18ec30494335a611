"""A correct small master passes every case."""

import pytest

pytestmark = [pytest.mark.soak, pytest.mark.timeout(240)]


@pytest.mark.parametrize("tasks", [("read", "write", "start", "stop", "reset"), ("poll",), ("keep",)])
def test_correct_master_fails_no_case(verdicts, tasks):
    found = verdicts(*tasks)
    assert len(found) > 15
    assert [f"{each.case}: {each.reason}" for each in found.values() if each.outcome == "failed"] == []
