"""Differences between virtual drives and their models are found by a proof, without any write or motion."""

from collections import Counter

import pytest
from planted_lies import LIES
from proved_drives import contradictions, proved

ENOUGH = 40


@pytest.fixture(scope="module")
def proofs():
    return {str(lie): proved(lie.of.partition("/")[0], lie.honest(), lie.drive()) for lie in LIES}


def finds(proving, about):
    return any(
        about in (each.kind, *each.addresses) or about in each.about or about in each.why
        for each in contradictions(proving)
    )


def test_there_are_forty_planted_lies_of_all_kinds():
    assert len({str(lie) for lie in LIES}) == 40
    assert len({lie.of.partition("/")[0] for lie in LIES}) >= 10
    assert len(Counter(lie.kind for lie in LIES)) >= 9


def test_proof_finds_the_planted_lies(proofs):
    missed = [str(lie) for lie in LIES if not finds(proofs[str(lie)], lie.about)]
    assert len(LIES) - len(missed) >= ENOUGH, missed


@pytest.mark.parametrize("lie", LIES, ids=str)
def test_proof_of_a_lying_drive_writes_and_moves_nothing(lie):
    drive = lie.drive()
    proved(lie.of.partition("/")[0], lie.honest(), drive)
    assert (drive.counts["writes"], drive.counts["commands"], drive.counts["turns"]) == (0, 0, 0)
