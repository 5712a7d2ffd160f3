"""Case folders: writing one, opening its key, and running one more experiment on it.

A folder has ``recordings/*.parquet``, ``robot.toml`` (what the operator believes), ``case.json``
(public: which groups are held out, and the hashes of what is sealed), ``key.sealed`` and
``truth.parquet.sealed``. The secret is not in it.
"""

from __future__ import annotations

import hashlib
import hmac
import io
import json
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import pyarrow as pa
import pyarrow.parquet as pq

import bench.motions
from bench.motions import ExperimentPlan
from bench.recording import Recording, write

from .case import Asked, Kind
from .drafts import Draft, draft
from .measure import Measured
from .scenes import Plan
from .seal import SealError, check_secret, digest, seal, unseal

CASE_FORMAT, KEY_FORMAT = "busemu-case/1", "busemu-key/1"


def write_case(directory: str | Path, seed: int, secret: str, asked: Asked | None = None) -> Path:
    """Draw a case and write its folder; returns it.

    The folder appears whole or not at all. Raises ``FileExistsError`` if it is there already,
    ``ValueError`` as :func:`bench.blind.case.draw` does. ``asked.rig`` may name a scene of
    :mod:`bench.blind.scenes`: a leg on a stand, or a whole robot.
    """
    folder = Path(directory)
    if folder.exists():
        raise FileExistsError(f"{folder}: is there already: take another name")
    check_secret(secret)
    asked = asked or Asked()
    case = draft(seed, asked)
    part = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    (part / "recordings").mkdir(parents=True)
    try:
        key = _key(folder.name, case, seed, asked, secret)
        _fill(part, case, key, secret)
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return folder


def _fill(folder: Path, case: Draft, key_document: dict[str, Any], secret: str) -> None:
    measured: list[Measured] = []
    name = key_document["case"]
    numbers: dict[str, int] = {}
    for index, (group, plan) in enumerate(case.plans):
        numbers[group] = numbers.get(group, 0) + 1
        late = index / max(1, len(case.plans) - 1)
        found = case.measure(plan, f"{group}-{numbers[group]:02d}", group, late)
        write(found.recording, folder / "recordings" / f"{found.recording.name}.parquet")
        measured.append(found)
    (folder / "robot.toml").write_text(case.robot_text(), "utf-8")
    oracle = {
        m.recording.name: {"group": m.recording.metadata["group"], "mse_rad2": m.oracle_mse_rad2}
        for m in measured
    }
    key = json.dumps({**key_document, "oracle": oracle}, indent=1, allow_nan=False).encode()
    buffer = io.BytesIO()
    pq.write_table(pa.concat_tables([m.truth for m in measured], promote_options="none"), buffer)
    truth = buffer.getvalue()
    (folder / "key.sealed").write_bytes(seal(key, secret, name))
    (folder / "truth.parquet.sealed").write_bytes(seal(truth, secret, name))
    public = {
        "format": CASE_FORMAT,
        "case": name,
        "held_out": list(case.held_out),
        "catalogue_without": list(case.names) if case.kind is Kind.DELETED else [],
        "key_sha256": digest(key),
        "truth_sha256": digest(truth),
    }
    (folder / "case.json").write_text(json.dumps(public, indent=1) + "\n", "utf-8")


def _key(name: str, case: Draft, seed: int, asked: Asked, secret: str) -> dict[str, Any]:
    return {
        "format": KEY_FORMAT,
        "case": name,
        "seed": seed,
        "asked": asked.document(),
        "generator": generator(),
        "nonce": hmac.digest(secret.encode(), f"{name} {seed}".encode(), "sha256").hex(),
        "kind": case.kind.value,
        "held_out": list(case.held_out),
        **case.told(),
    }


def read_public(case: str | Path) -> dict[str, Any]:
    """``case.json`` of a folder. Raises :class:`SealError` if the folder is no case."""
    path = Path(case) / "case.json"
    try:
        document: dict[str, Any] = json.loads(path.read_text("utf-8"))
    except (OSError, json.JSONDecodeError) as error:
        raise SealError(f"{path}: is no case: {error}") from None
    return document


def _open(case: str | Path, secret: str, file: str, hash_of: str) -> bytes:
    public = read_public(case)
    content = unseal((Path(case) / file).read_bytes(), secret, public["case"])
    if digest(content) != public[hash_of]:
        raise SealError(f"{Path(case) / file}: is not what was published as {hash_of}")
    return content


def open_key(case: str | Path, secret: str) -> dict[str, Any]:
    """The key of a case folder, checked against its published hash. Raises :class:`SealError`."""
    key: dict[str, Any] = json.loads(_open(case, secret, "key.sealed", "key_sha256"))
    return key


def open_truth(case: str | Path, secret: str) -> pa.Table:
    """The true positions of a case; columns as in :class:`bench.blind.measure.Measured`."""
    content = _open(case, secret, "truth.parquet.sealed", "truth_sha256")
    return pq.read_table(io.BytesIO(content))


def rerun(case: str | Path, secret: str, plan: Plan) -> Recording:
    """Run one more experiment on the same hidden specimen, at the end of its session.

    Raises :class:`SealError`; also if the generator has changed since the case was written. Raises
    ``ValueError`` for a plan that the case's rig or robot cannot carry out.
    """
    key = open_key(case, secret)
    if key["generator"] != generator():
        raise SealError(f"{case}: was made by another version of the generator: write it again")
    mark = digest(json.dumps(plan.document(), sort_keys=True).encode())[:8]
    what = plan.motion.name if isinstance(plan, ExperimentPlan) else "walk"
    name = f"next-{what}-{mark}"
    return draft(key["seed"], Asked.of(key["asked"])).measure(plan, name, name, 1.0).recording


@cache
def generator() -> str:
    """A hash of the generator: its sources and the engine's version."""
    total = hashlib.sha256(mujoco.__version__.encode())
    for path in (*sorted(Path(__file__).parent.glob("*.py")), Path(bench.motions.__file__)):
        total.update(path.read_bytes())
    return total.hexdigest()[:16]
