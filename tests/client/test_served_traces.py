"""Traces and recordings of a served line: one that fails does not disturb the others."""

import pytest
from running_server import running_server

import drivecomm


def test_recording_continues_after_a_trace_function_raises(plant):
    told, kept = [], []

    class Record:
        def add(self, piece):
            kept.append(piece)

    def trace(event):
        told.append(event)
        raise RuntimeError("a mistake in a trace function")

    def read():
        with drivecomm.open_plant(plant, trace=trace, record=Record()) as opened:
            for _ in range(3):
                assert opened.drive("pump").read("481").value == 10

    with running_server(plant), pytest.raises(RuntimeError, match="a mistake in a trace function"):
        read()
    assert len(told) == 1
    assert sum(each.source == "master" for each in kept) >= 3
