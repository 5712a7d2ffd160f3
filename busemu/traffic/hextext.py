"""Bytes as people and programs write them down, back to bytes."""

from __future__ import annotations

import ast
import re

#: What may stand between two bytes, or around them: a list, a C array, a MAC-like notation.
_BETWEEN = re.compile(r"[\s,;:{}()\[\]\"']+|0x|\\x|\\", re.IGNORECASE)
_COMMENT = re.compile(r"#.*")
_LITERAL = re.compile(r"""\s*b(?P<quote>['"]).*(?P=quote)\s*""", re.DOTALL)


class HexError(ValueError):
    """Text that is no bytes: says which part and what is understood."""


def bytes_of_text(text: str) -> bytes:
    r"""The bytes that a text means: `FF FF 01`, `fffffd00`, `0xFF, 0x01`, `\xff\x01`, `b'\xff%'`.

    What follows a # on a line is a comment. Raises :class:`HexError`.
    """
    if _LITERAL.fullmatch(text):
        try:
            value = ast.literal_eval(text.strip())
        except (ValueError, SyntaxError):
            raise HexError(f"not a Python bytes literal: {text.strip()[:40]}") from None
        if isinstance(value, bytes):
            return value
    data = bytearray()
    for line in text.splitlines():
        for word in _BETWEEN.split(_COMMENT.sub("", line)):
            digits = "0" + word if len(word) == 1 else word
            try:
                data += bytes.fromhex(digits)
            except ValueError:
                raise HexError(
                    f"not hex: {word[:40]!r}; write bytes as FF FF FD 00, fffffd00 or 0xFF, 0xFF"
                ) from None
    return bytes(data)


def bytes_of_input(data: bytes) -> bytes:
    """The bytes that an input means: hex where all of it is text in hex, else itself."""
    try:
        text = data.decode("ascii")
    except UnicodeDecodeError:
        return data
    if any(ord(letter) < 32 and not letter.isspace() for letter in text):
        return data
    return bytes_of_text(text)
