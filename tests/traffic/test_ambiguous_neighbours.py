"""Advice of `cohabit` for drives whose protocols declare their telegrams ambiguous, beyond proofs by telegrams."""

import pytest

from drivecomm.protocol import DriveConfig
from drivecomm.traffic.cohabitation import PairVerdict, Safety, check, check_line


@pytest.mark.parametrize(("address", "is_said"), [(1, True), (2, False)])
def test_cohabit_advises_on_ambiguous_telegrams_at_the_same_address(monkeypatch, address, is_said):
    def verdict(speaker, listener):
        return PairVerdict(speaker=speaker.name, listener=listener.name, outcome=Safety.TAKEN, reason="")

    monkeypatch.setattr(check, "listen", verdict)
    monkeypatch.setattr(check, "wait_for", verdict)
    monkeypatch.setattr(check, "_is_excluded", lambda *_: False)
    drives = [DriveConfig(protocol="huanyang", address=1), DriveConfig(protocol="modbus", address=address)]
    said = [each for each in check_line(drives).advice if each.startswith("huanyang:1 beside modbus")]
    assert len(said) == is_said
    for sentence in said:
        assert "from 0300H on writes a parameter" in sentence
        assert "no page says" in sentence
