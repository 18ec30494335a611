"""Judging codecs: test vectors as data, and what every telegram of every protocol must stand."""
