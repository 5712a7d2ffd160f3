"""A table that extends another: the base's document with the differences written over it.

``extends = "XM430-W350"`` names a model, a base (``"base-x"``, a file without a ``model``) or a
TOML file beside the one that says it. Then, from the base to the file:

* a row of ``register`` with a known name changes the keys it gives; one with a new name is added;
* ``remove`` lists registers that the base has and this model has not;
* the register ``model_number`` starts with the file's ``model_number``;
* ``drive`` and ``instructions`` are merged key by key; any other key replaces the base's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .spelling import near
from .toml_file import read_toml

SERVOS = Path(__file__).with_name("servos")

MERGED = ("drive", "instructions")


class TableError(ValueError):
    """A control table that cannot be used: says the file, the register, the rule."""


def file_name(model: str) -> str:
    """The file of a model; that of ``"MX-28(2.0)"`` is ``mx-28-2.toml``, as in the e-manual."""
    return model.lower().replace("(2.0)", "-2") + ".toml"


def resolve(document: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """The whole document of a table, all that it extends included.

    Raises :class:`TableError` for a base that is not there, a circle of bases, a row without a
    name, and the removal of a register that the base does not have.
    """
    return _resolve(dict(document), path, (path.resolve(),))


def _resolve(document: dict[str, Any], path: Path, seen: tuple[Path, ...]) -> dict[str, Any]:
    rows = _named_rows(document, path)
    removed = document.pop("remove", [])
    if not isinstance(removed, list | tuple) or not all(isinstance(r, str) for r in removed):
        raise TableError(f"{path}: remove must be a list of register names, not {removed!r}")
    for key in MERGED:
        if not isinstance(document.get(key, {}), Mapping):
            raise TableError(f"{path}: {key} must be a table, not {document[key]!r}")
    if "extends" not in document:
        if removed:
            raise TableError(f"{path}: remove needs extends: there is nothing to remove from")
        return {**document, "register": list(rows.values())} if rows else document
    base_path = _base_path(document.pop("extends"), path)
    if base_path.resolve() in seen:
        circle = " -> ".join(p.name for p in (*seen, base_path))
        raise TableError(f"{path}: extends itself: {circle}")
    base = _resolve(read_toml(base_path, TableError), base_path, (*seen, base_path.resolve()))
    merged = _merged(_named_rows(base, base_path), base_path.name, rows, removed, path)
    if "model_number" in document and "model_number" in merged:
        told = rows.get("model_number", {}).get("initial", document["model_number"])
        merged["model_number"] = {**merged["model_number"], "initial": told}
    for key in MERGED:
        if key in base and key in document:
            document[key] = {**base[key], **document[key]}
    return {**base, **document, "register": list(merged.values())}


def _merged(
    base: dict[str, dict[str, Any]],
    base_name: str,
    rows: Mapping[str, dict[str, Any]],
    removed: Sequence[str],
    path: Path,
) -> dict[str, dict[str, Any]]:
    """The rows of the base without the ``removed`` ones, with ``rows`` written over them."""
    merged = dict(base)
    for name in removed:
        if merged.pop(name, None) is None:
            hint = near(name, merged)
            raise TableError(f"{path}: remove: {base_name} has no register {name!r}{hint}")
    for name, row in rows.items():
        if name not in merged and not {"address", "size"} <= set(row):
            raise TableError(
                f"{path}: register {name!r}: {base_name} has none of that name"
                f"{near(name, merged)}; a new one needs address and size"
            )
        merged[name] = {**merged.get(name, {}), **row}
    return merged


def _base_path(name: Any, path: Path) -> Path:
    if not isinstance(name, str):
        raise TableError(f"{path}: extends must be the name of one table, not {name!r}")
    file = name if name.endswith(".toml") else file_name(name)
    for folder in (path.parent, SERVOS):
        if (folder / file).is_file():
            return folder / file
    raise TableError(f"{path}: extends {name!r}: there is no {file} beside it or in {SERVOS}")


def _named_rows(document: Mapping[str, Any], path: Path) -> dict[str, dict[str, Any]]:
    rows: dict[str, dict[str, Any]] = {}
    listed = document.get("register", [])
    if not isinstance(listed, list | tuple) or not all(isinstance(row, Mapping) for row in listed):
        raise TableError(f"{path}: register must be a list of tables: [{{ name = ... }}, ...]")
    for row in listed:
        name = row.get("name")
        if not isinstance(name, str) or not name:
            raise TableError(f"{path}: register '?': needs a name: {row}")
        if name in rows:
            raise TableError(f"{path}: register {name!r} is there twice")
        rows[name] = dict(row)
    return rows
