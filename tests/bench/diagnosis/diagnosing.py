"""``busemu diagnose`` in a process of its own, on recordings in a folder."""

import programs

from bench.diagnosis.knobs import joint_effects
from bench.recording import write

KNOWN = ("viscous_friction", "coulomb_friction")


def busemu(*words, timeout_s=300):
    return programs.busemu("diagnose", *words, timeout_s=timeout_s)


def without_most():
    """Words that leave :data:`KNOWN` of the catalogue."""
    return [word for name in joint_effects() if name not in KNOWN for word in ("--without", name)]


def written(folder, recordings):
    folder.mkdir(exist_ok=True)
    return [write(one, folder / f"{one.name}.parquet") for one in recordings]


def refused(done, *words):
    """One line at the terminal, and no traceback."""
    assert done.returncode == 1, done.stdout
    lines = [line for line in done.stderr.strip().splitlines() if not _is_stage(line)]
    (line,) = lines
    for word in ("busemu: ", *words):
        assert word in line


def _is_stage(line):
    return line.lstrip()[:1].isdigit() and " s  " in line
