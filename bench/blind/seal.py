"""Sealing: what must not be read before a diagnosis is encrypted, and its hash is published."""

from __future__ import annotations

import base64
import hashlib

from cryptography.fernet import Fernet, InvalidToken
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.kdf.hkdf import HKDF


class SealError(ValueError):
    """A seal that cannot be opened: says the file and why."""


def _box(secret: str, case: str) -> Fernet:
    derived = HKDF(
        algorithm=hashes.SHA256(), length=32, salt=b"busemu-case/1", info=case.encode()
    ).derive(secret.encode())
    return Fernet(base64.urlsafe_b64encode(derived))


def check_secret(secret: str) -> None:
    """Raise :class:`SealError` for a secret that is too short."""
    if len(secret) < 16:
        raise SealError("the secret is shorter than 16 characters: take a long random one")


def seal(content: bytes, secret: str, case: str) -> bytes:
    """Encrypt for a case; ``secret`` must be long and random."""
    check_secret(secret)
    return _box(secret, case).encrypt(content)


def unseal(sealed: bytes, secret: str, case: str) -> bytes:
    """The content again. Raises :class:`SealError` for a wrong secret or a changed file."""
    try:
        return _box(secret, case).decrypt(sealed)
    except InvalidToken:
        raise SealError(
            f"{case}: the seal does not open: another secret, another case's file, or changed since"
        ) from None


def digest(content: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(content).hexdigest()
