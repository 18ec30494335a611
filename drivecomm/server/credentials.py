"""Tokens and passwords: created here, and stored only as hashes.

A token is random, so one round of SHA-256 protects it. A password can be guessed, so each guess must cost time.
"""

from __future__ import annotations

import hashlib
import re
import secrets
from base64 import b64decode, b64encode

from drivecomm.errors import UsageError

SHORTEST_PASSWORD = 8
LONGEST_PASSWORD = 200
_TOKEN = re.compile(r"sha256:[0-9a-f]{64}")
_PASSWORD = re.compile(r"scrypt:(\d{1,7}):(\d{1,2}):(\d{1,2}):([A-Za-z0-9+/=]{22,88}):([A-Za-z0-9+/=]{43,88})")
_COST = (2**14, 8, 5)
"""Cost of a password hash: 16 MiB and some tenths of a second for each guess."""
_MOST_MEMORY = 2**26


def new_token() -> str:
    """Return a random token of 256 bits."""
    return secrets.token_urlsafe(32)


def token_hash(token: str) -> str:
    """Return the SHA-256 hash under which a token is stored."""
    return f"sha256:{hashlib.sha256(token.encode(errors='replace')).hexdigest()}"


def is_token_hash(text: str) -> bool:
    """Return whether a text is the hash of a token."""
    return _TOKEN.fullmatch(text) is not None


def password_hash(password: str) -> str:
    """Return the salted hash of a password. Raises UsageError if its length is out of range."""
    if not SHORTEST_PASSWORD <= len(password) <= LONGEST_PASSWORD:
        raise UsageError(f"a password has {SHORTEST_PASSWORD} to {LONGEST_PASSWORD} characters; choose another one")
    salt = secrets.token_bytes(16)
    cost = ":".join(map(str, _COST))
    return f"scrypt:{cost}:{b64encode(salt).decode()}:{b64encode(_scrypt(password, salt, *_COST)).decode()}"


def is_password_hash(text: str) -> bool:
    """Return whether a text is a password hash that is strong enough, and not too costly to verify."""
    found = _PASSWORD.fullmatch(text)
    if not found:
        return False
    n, r, p = (int(each) for each in found.groups()[:3])
    try:
        b64decode(found[4], validate=True), b64decode(found[5], validate=True)
    except ValueError:
        return False
    return n >= _COST[0] and n & (n - 1) == 0 and r > 0 and 0 < p <= 20 and 128 * r * (n + p + 2) <= _MOST_MEMORY


def password_fits(password: str, known: str) -> bool:
    """Return whether a password matches a hash; takes the same time either way."""
    _, n, r, p, salt, wanted = known.split(":")
    found = _scrypt(password[: LONGEST_PASSWORD + 1], b64decode(salt), int(n), int(r), int(p))
    return secrets.compare_digest(found, b64decode(wanted))


def _scrypt(password: str, salt: bytes, n: int, r: int, p: int) -> bytes:
    data = password.encode(errors="replace")
    return hashlib.scrypt(data, salt=salt, n=n, r=r, p=p, maxmem=2 * _MOST_MEMORY, dklen=32)
