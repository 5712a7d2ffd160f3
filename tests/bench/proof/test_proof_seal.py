"""The seal: a diagnosis cannot read a key, and what was published cannot be changed unnoticed."""

import json
import os
import shutil
import signal
import socket
import sys

import pytest
from sealed_cases import small_proof

from bench.blind.seal import digest, seal
from bench.proof import confined, published
from bench.proof.answering import Answers
from bench.proof.errors import ProofError

CONFINED = pytest.mark.skipif(not confined.version(), reason="this kernel has no Landlock")


@pytest.fixture(scope="module", autouse=True)
def _sources_that_nobody_edits():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(published, "sources", lambda: "as published")
        yield


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A proof whose cases are written and published, and nothing more."""
    proof = small_proof(tmp_path_factory.mktemp("written") / "proof")
    proof.prepare()
    proof.write()
    proof.publish()
    return proof


@pytest.fixture
def proof(written, tmp_path):
    """A copy of it to work on."""
    shutil.copytree(written.folder, tmp_path / "proof")
    shutil.copy(written.secret_path, tmp_path / "proof.secret")
    return small_proof(tmp_path / "proof")


def answered(proof, *words):
    """Diagnose with the diagnoser that tries the words; what came of it."""
    trying = small_proof(proof.folder, *words)
    names = list(trying.answer())
    return trying, json.loads((trying.answers.answers / names[0] / "pried.json").read_text())


@CONFINED
def test_the_diagnosing_process_cannot_open_what_is_sealed(proof, monkeypatch):
    monkeypatch.setenv("PROOF_SECRET", proof.secret)
    (proof.folder.parent / "elsewhere").write_text("a note")
    case = proof.cases / "case-0001"
    forbidden = [
        case / "key.sealed",
        case / "truth.parquet.sealed",
        case / "case.json",
        proof.secret_path,
        proof.folder / "published.json",
        proof.folder.parent / "elsewhere",
        f"/proc/{os.getpid()}/cmdline",
        f"/proc/{os.getpid()}/environ",
        f"/proc/{os.getpid()}/mem",
    ]
    assert all(os.access(path, os.R_OK) for path in forbidden)  # this process can
    _, told = answered(proof, *map(str, forbidden), sys.executable)
    assert told["tried"].pop(sys.executable) == "read"  # what it may read, it reads
    assert set(told["tried"].values()) == {"PermissionError"}
    assert proof.secret not in json.dumps(told)
    assert not any("seal" in name or "case" in name for name in told["staged"])


@CONFINED
def test_the_diagnosing_process_has_no_network(proof):
    with socket.create_server(("127.0.0.1", 0)) as server:
        word = f"connect:{server.getsockname()[1]}"
        _, told = answered(proof, word)
    assert told["tried"] == {word: "PermissionError"}


def test_the_diagnosing_process_is_told_nothing_but_the_public_part(proof):
    _, told = answered(proof)
    recordings = sorted(p.name for p in (proof.cases / "case-0001" / "recordings").iterdir())
    staged = ["recordings", *(f"recordings/{name}" for name in recordings)]
    assert told["staged"] == sorted([*staged, "robot.toml", "told.json"])
    allowed = {"PATH", "HOME", "LANG", "LC_ALL", "LC_CTYPE", "TZ", "LD_LIBRARY_PATH", "PYTHONPATH"}
    allowed |= {"OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "PYTHONDONTWRITEBYTECODE", "TMPDIR"}
    assert set(told["environment"]) <= allowed


def test_hashes_are_published_before_anything_is_diagnosed(written):
    told = json.loads((written.folder / "published.json").read_text())
    assert set(told["cases"]) == {"case-0001", "case-0002"}
    assert not written.answers.answers.exists()


def test_a_key_that_was_changed_is_noticed(proof):
    trying, _ = answered(proof)
    told = trying.publish()
    case = proof.cases / "case-0001"
    forged = json.dumps({"kind": "null", "forged": True}).encode()
    (case / "key.sealed").write_bytes(seal(forged, proof.secret, "case-0001"))
    with pytest.raises(ProofError, match="key_sha256"):
        trying.open(told)


def test_a_key_that_was_changed_with_its_hash_is_noticed(proof):
    trying, _ = answered(proof)
    told = trying.publish()
    case = proof.cases / "case-0001"
    forged = json.dumps({"kind": "null", "forged": True}).encode()
    (case / "key.sealed").write_bytes(seal(forged, proof.secret, "case-0001"))
    public = json.loads((case / "case.json").read_text())
    (case / "case.json").write_text(json.dumps({**public, "key_sha256": digest(forged)}))
    with pytest.raises(ProofError, match="not the one that was published"):
        trying.open(told)
    with pytest.raises(ProofError, match="not those that were published"):
        trying.publish()


def test_a_diagnoser_that_changed_is_refused(proof, monkeypatch):
    monkeypatch.setattr(published, "sources", lambda: "another")
    with pytest.raises(ProofError, match="has changed since it was published"):
        proof.publish()


def test_a_finished_proof_can_be_scored_whatever_the_diagnoser_is_now(proof, monkeypatch):
    trying, _ = answered(proof)
    monkeypatch.setattr(published, "sources", lambda: "another")
    assert trying.publish() == json.loads((proof.folder / "published.json").read_text())


def test_an_answer_that_changed_after_the_keys_were_opened_is_noticed(proof):
    trying, _ = answered(proof)
    told = trying.publish()
    assert set(trying.open(told)) == {"case-0001", "case-0002"}
    assert trying.open(told)["case-0001"]["kind"] == "null"  # opened again, all as it was
    answer = trying.answers.answers / "case-0001" / "diagnosis.json"
    answer.write_text(answer.read_text() + " ")
    with pytest.raises(ProofError, match="answers have changed"):
        trying.open(told)


def test_no_case_is_diagnosed_after_the_keys_were_opened(proof):
    trying, _ = answered(proof)
    trying.open(trying.publish())
    shutil.rmtree(trying.answers.answers / "case-0002")
    with pytest.raises(ProofError, match="no case is diagnosed any more"):
        list(trying.answer())


def test_keys_stay_shut_while_cases_are_left(proof):
    told = proof.publish()
    with pytest.raises(ProofError, match="no answer yet"):
        proof.open(told)
    assert not (proof.folder / "keys").exists()


def test_finished_cases_are_not_diagnosed_again(proof):
    trying, _ = answered(proof)
    before = {p: p.stat().st_mtime_ns for p in trying.answers.answers.rglob("*.json")}
    assert list(trying.answer()) == []
    shutil.rmtree(trying.answers.answers / "case-0002")
    assert list(trying.answer()) == ["case-0002"]
    kept = [p for p in before if "case-0001" in str(p)]
    assert kept
    assert all(p.stat().st_mtime_ns == before[p] for p in kept)


def test_cases_are_not_written_again(proof):
    key = proof.cases / "case-0001" / "key.sealed"
    before = key.read_bytes()
    proof.write()
    assert key.read_bytes() == before


def test_a_diagnosis_that_fails_is_an_answer(proof):
    failing = small_proof(proof.folder, "fail")
    assert sorted(failing.answer()) == ["case-0001", "case-0002"]
    diagnosis, told = failing.answers.read("case-0001")
    assert diagnosis is None
    assert told["failure"] == "there is nothing to be seen"
    assert list(failing.answer()) == []


def test_a_diagnosis_that_is_killed_gets_a_second_try(proof, monkeypatch):
    tries = []
    job = Answers._job
    monkeypatch.setattr(
        Answers, "_job", lambda self, name, told: tries.append(name) or job(self, name, told)
    )
    killed = small_proof(proof.folder, "killed")
    assert sorted(killed.answer()) == ["case-0001", "case-0002"]
    assert sorted(tries) == ["case-0001", "case-0001", "case-0002", "case-0002"]
    diagnosis, told = killed.answers.read("case-0001")
    assert diagnosis is None
    assert told["failure"] == f"ended by signal {int(signal.SIGKILL)}, twice"


def test_a_lost_secret_is_said(proof):
    proof.secret_path.unlink()
    with pytest.raises(ProofError, match="is gone, and with it the keys"):
        proof.prepare()


def test_a_folder_that_diagnoses_can_read_is_refused():
    proof = small_proof(published.ROOT / "bench" / "proof-here")
    with pytest.raises(ProofError, match="which a diagnosis reads"):
        proof.prepare()


def test_a_run_that_was_interrupted_goes_on(proof):
    answering = proof.answer()
    done = next(answering)
    answering.close()  # as Ctrl-C does
    left = [name for name in proof.had if not proof.answers.finished(name)]
    assert done not in left
    assert sorted(proof.answer()) == left
    assert all(proof.answers.finished(name) for name in proof.had)
