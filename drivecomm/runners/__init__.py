"""The places that wait: each turns the effects of a link into time and I/O."""
