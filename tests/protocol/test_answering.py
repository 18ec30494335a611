"""Verbs that need an answer, where nobody gives one."""

import inspect

import pytest

from drivecomm.errors import NotSupported
from drivecomm.protocol import needs_answer


class Verbs:
    def __init__(self, *, answers):
        self.answers = answers

    @needs_answer
    def status(self):
        """Ask for it."""
        return (yield)

    @needs_answer
    def set_reference_percent(self, percent, *, twice=False):
        return percent * (1 + twice)


def test_where_a_drive_answers_nothing_is_different():
    verbs = Verbs(answers=True)
    assert verbs.set_reference_percent(2, twice=True) == 4
    assert inspect.isgenerator(verbs.status())


@pytest.mark.parametrize(("verb", "given"), [("status", ()), ("set_reference_percent", (2,))])
def test_where_nobody_answers_it_is_refused_when_it_is_called(verb, given):
    with pytest.raises(NotSupported, match=rf"^{verb.removesuffix('_percent')} needs an answer, and no drive answers"):
        getattr(Verbs(answers=False), verb)(*given)


def test_what_is_known_of_a_verb_stays_known():
    assert Verbs.status.__doc__ == "Ask for it."
    assert list(inspect.signature(Verbs(answers=True).set_reference_percent).parameters) == ["percent", "twice"]
