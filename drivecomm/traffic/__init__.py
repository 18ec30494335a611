"""What is on a line: the sniffer, which drives share a line, replays."""
