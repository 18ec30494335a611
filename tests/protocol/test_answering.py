"""Verbs that need an answer, on a drive that gives none."""

import inspect

import pytest

from drivecomm.errors import NotSupported
from drivecomm.protocol import needs_answer


class Verbs:
    def __init__(self, *, answers):
        self.answers = answers

    @needs_answer
    def status(self):
        """Read the status."""
        return (yield)

    @needs_answer
    def set_reference_percent(self, percent, *, twice=False):
        return percent * (1 + twice)


def test_verbs_of_an_answering_drive_are_unchanged():
    verbs = Verbs(answers=True)
    assert verbs.set_reference_percent(2, twice=True) == 4
    assert inspect.isgenerator(verbs.status())


@pytest.mark.parametrize(("verb", "given"), [("status", ()), ("set_reference_percent", (2,))])
def test_verb_that_needs_an_answer_is_refused_without_answers(verb, given):
    with pytest.raises(NotSupported, match=rf"^{verb.removesuffix('_percent')} needs an answer, and no drive answers"):
        getattr(Verbs(answers=False), verb)(*given)


def test_decorated_verb_keeps_its_docstring_and_signature():
    assert Verbs.status.__doc__ == "Read the status."
    assert list(inspect.signature(Verbs(answers=True).set_reference_percent).parameters) == ["percent", "twice"]
