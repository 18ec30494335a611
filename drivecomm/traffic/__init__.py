"""Traffic on a line: the sniffer, the check which drives can share a line, and replays of captures."""
