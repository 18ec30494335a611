"""Trusted client programs: those with a certificate in a folder, or with one issued by an authority in it."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from asyncua import ua
from asyncua.common.utils import ServiceError
from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding

from drivecomm.errors import UsageError, shortened

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

_SUFFIXES = frozenset({".pem", ".crt", ".cer", ".der"})
_MOST_REJECTED = 20
"""Maximum number of stored certificates of strangers, who can create any number of them."""


class TrustedClients:
    """Folder of trusted certificates, PEM or DER, read again for each client so that changes apply immediately.

    A client is refused if its certificate is on a revocation list (.crl) in the folder, issued by an authority in the
    folder. The certificate of a client that is not trusted is stored in the subfolder `rejected`, from where it can be
    moved up. tell: called once per such certificate. Raises UsageError if the folder is missing or a file in it is
    invalid.
    """

    def __init__(self, folder: Path, tell: Callable[[str], None]) -> None:
        if not folder.is_dir():
            raise UsageError(f"{folder} is not a folder; make it, and put the certificates of permitted clients there")
        for file in _files(folder):
            try:
                certificates_in(file)
            except (OSError, ValueError) as error:
                raise UsageError(f"{file} is not a certificate of a client: {error}") from error
        for file in _lists(folder):
            try:
                _revocations_in(file)
            except (OSError, ValueError) as error:
                raise UsageError(f"{file} is not a list of revoked certificates: {error}") from error
        self._folder, self._rejected = folder, folder / "rejected"
        self._tell = tell
        self._told: set[str] = set()

    async def check(self, shown: bytes | None) -> None:
        """Raise ServiceError unless the client has a trusted and currently valid certificate."""
        try:
            certificate = x509.load_der_x509_certificate(shown or b"")
        except ValueError as error:
            raise ServiceError(ua.StatusCodes.BadCertificateInvalid) from error
        if not await asyncio.to_thread(self._trusts, certificate):
            await asyncio.to_thread(self._reject, certificate)
            raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)
        if not _is_valid(certificate):
            raise ServiceError(ua.StatusCodes.BadCertificateTimeInvalid)
        await asyncio.to_thread(self._check_revocation, certificate)

    def _known(self) -> Iterator[x509.Certificate]:
        for file in _files(self._folder):
            # The file is just being written or removed.
            with suppress(OSError, ValueError):
                yield from certificates_in(file)

    def _trusts(self, certificate: x509.Certificate) -> bool:
        return any(known == certificate or _has_issued(known, certificate) for known in self._known())

    def _check_revocation(self, certificate: x509.Certificate) -> None:
        authorities = [known for known in self._known() if _has_issued(known, certificate)]
        for file in _lists(self._folder):
            try:
                revoked = _revocations_in(file)
            except (OSError, ValueError) as error:
                # The unreadable list may be the one that revokes this client.
                if authorities:
                    raise ServiceError(ua.StatusCodes.BadCertificateRevocationUnknown) from error
                continue
            if any(_has_signed(authority, revoked) for authority in authorities) and (
                revoked.get_revoked_certificate_by_serial_number(certificate.serial_number) is not None
            ):
                raise ServiceError(ua.StatusCodes.BadCertificateRevoked)

    def _reject(self, certificate: x509.Certificate) -> None:
        fingerprint = certificate.fingerprint(SHA256()).hex()
        if fingerprint in self._told or len(self._told) >= _MOST_REJECTED:
            return
        self._told.add(fingerprint)
        file = self._rejected / f"{fingerprint[:40]}.der"
        try:
            self._rejected.mkdir(exist_ok=True)
            if len(list(self._rejected.iterdir())) < _MOST_REJECTED:
                file.write_bytes(certificate.public_bytes(Encoding.DER))
        except OSError:
            file = self._folder
        where = f"; to admit it, move {file} to {self._folder}" if file.is_file() else f"; it is not in {self._folder}"
        who = shortened(certificate.subject.rfc4514_string())
        self._tell(f"refused a client: its certificate {who}, SHA-256 {fingerprint}, is not trusted{where}")


def _files(folder: Path) -> Iterator[Path]:
    return (file for file in sorted(folder.iterdir()) if file.suffix.lower() in _SUFFIXES)


def _lists(folder: Path) -> Iterator[Path]:
    return (file for file in sorted(folder.iterdir()) if file.suffix.lower() == ".crl")


def _revocations_in(file: Path) -> x509.CertificateRevocationList:
    content = file.read_bytes()
    if b"-----BEGIN" in content:
        return x509.load_pem_x509_crl(content)
    return x509.load_der_x509_crl(content)


def _has_signed(authority: x509.Certificate, revoked: x509.CertificateRevocationList) -> bool:
    # A list from another issuer does not apply.
    return revoked.issuer == authority.subject and revoked.is_signature_valid(authority.public_key())  # type: ignore[arg-type]


def certificates_in(file: Path) -> list[x509.Certificate]:
    """Return the certificates of a file, PEM or DER. Raises OSError, or ValueError if it has none."""
    content = file.read_bytes()
    if b"-----BEGIN" in content:
        return x509.load_pem_x509_certificates(content)
    return [x509.load_der_x509_certificate(content)]


def _has_issued(authority: x509.Certificate, certificate: x509.Certificate) -> bool:
    try:
        if not authority.extensions.get_extension_for_class(x509.BasicConstraints).value.ca:
            return False
        certificate.verify_directly_issued_by(authority)
    except (x509.ExtensionNotFound, InvalidSignature, UnsupportedAlgorithm, TypeError, ValueError):
        return False
    return _is_valid(authority)


def _is_valid(certificate: x509.Certificate) -> bool:
    return certificate.not_valid_before_utc <= datetime.now(UTC) <= certificate.not_valid_after_utc
