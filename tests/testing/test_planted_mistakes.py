"""One mistake planted at a time in a package that ships, and the check that finds it."""

from dataclasses import replace

import pytest

from drivecomm.protocol import Ask, installed, with_each_command
from drivecomm.testing import QUICK, all_checks, try_out


def reasons(plugin, kind):
    """Return why the checks of this kind do not hold."""
    found = [try_out(each) for each in all_checks(plugin, QUICK) if each.kind == kind]
    assert found, f"there is no check {kind!r}"
    return " ".join(each.reason for each in found)


def asking(change):
    """Return a maker of a verb that asks what a function makes of each of its questions."""

    def make(verb):
        def carried_out(*values, **options):
            return with_each_command(verb(*values, **options), lambda each: change(each) if type(each) is Ask else each)

        return carried_out

    return make


def with_verbs(with_operations, name, change, *verbs):
    return with_operations(
        name, **{verb: lambda real, verb=verb: asking(change)(getattr(real, verb)) for verb in verbs}
    )


NAMING = "a question that anothers answer fits is declared"


@pytest.mark.parametrize("name", ["modbus", "vlt3500"])
def test_reads_that_are_not_called_nameless(with_operations, name):
    plugin = with_verbs(with_operations, name, lambda ask: replace(ask, nameless=False), "read")
    assert "which is not asked as nameless" in reasons(plugin, NAMING)


@pytest.mark.parametrize("name", ["modbus", "vlt3500"])
def test_reads_that_are_called_distinct_and_are_not(with_operations, name):
    plugin = with_verbs(with_operations, name, lambda ask: replace(ask, nameless=False, distinct=True), "read")
    assert "which is asked as distinct" in reasons(plugin, NAMING)


def test_status_that_is_not_called_nameless(with_operations):
    """What several telegrams ask, and what reads no parameter, is held against the rest as well."""
    plugin = with_verbs(with_operations, "modbus", lambda ask: replace(ask, nameless=False), "status")
    assert "in status, which is not asked as nameless" in reasons(plugin, NAMING)


def test_write_that_is_not_called_nameless(with_operations):
    plugin = with_verbs(with_operations, "vabus", lambda ask: replace(ask, nameless=False), "write")
    assert "which is not asked as nameless" in reasons(plugin, NAMING)


def test_refusal_that_names_nothing_is_no_false_alarm():
    assert not reasons(installed["vabus"], NAMING)
