"""Reading a TOML file that a user wrote, with one clear line where that cannot be done."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any


def read_toml(path: Path, error: type[Exception], where: str = "") -> dict[str, Any]:
    """The document of a file. Raises ``error`` with the file and why.

    ``where`` is how the user named the file, by default its path.
    """
    where = where or str(path)
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except OSError as failure:
        raise error(f"{where}: cannot be read: {failure.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as failure:
        raise error(f"{where}: not a TOML file: {failure}") from None
