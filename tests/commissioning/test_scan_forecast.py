"""Forecast of how long a scan takes, made before a port is open."""

import pytest
from addresses import address_of

import drivecomm
from drivecomm.bus import LineChoices
from drivecomm.commissioning import forecast_scan
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine


@pytest.mark.parametrize("choices", [None, LineChoices(baudrates=(9600, 19200), parities=("E", "N"))])
@pytest.mark.parametrize("protocol", sorted(installed))
def test_scan_of_a_line_without_drives_takes_as_long_as_forecast(protocol, choices):
    line, addresses = VirtualLine([]), [address_of(protocol, number) for number in range(1, 9)]
    forecast = forecast_scan([protocol], addresses, choices)
    asked = []
    with drivecomm.open_bus(line.port) as bus:
        began = bus.now()
        assert not list(bus.scan([protocol], addresses, choices=choices, progress=lambda *step: asked.append(step)))
        took = bus.now() - began
    assert forecast.questions == len(asked) - 1
    assert took == pytest.approx(forecast.seconds, rel=0.02)


def test_reply_timeout_for_all_protocols_counts_in_the_forecast():
    quick = forecast_scan(["vabus"], [1, 2, 3], reply_timeout_s=0.05)
    slow = forecast_scan(["vabus"], [1, 2, 3], reply_timeout_s=0.5)
    assert slow.seconds - quick.seconds == pytest.approx(3 * 0.45)
    assert quick.settings == 1
