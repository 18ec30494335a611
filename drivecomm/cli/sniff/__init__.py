"""The sniff command: where the bytes come from, what they are called, how it is shown."""
