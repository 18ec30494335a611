"""Traffic on a line: the sniffer, the cohabitation check, and replays of captures."""
