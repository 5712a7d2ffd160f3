"""``python -m bench.proof.confined``: run a module in a process that reads only what it is given.

The kernel does it (Landlock, Linux 5.13 and later): from then on neither this process nor what it
starts can open another file, look into another process, or, with Landlock 4, open a TCP
connection. Nothing that is imported after it can take it back. Only the standard library is
imported before.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import runpy
import signal
import struct
import sys
from collections.abc import Iterable
from pathlib import Path

# Linux system calls and constants: include/uapi/linux/landlock.h, include/uapi/linux/prctl.h
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
ASK_VERSION = 1
PATH_BENEATH = 1
SET_DEATH_SIGNAL, SET_NO_NEW_PRIVILEGES = 1, 38
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR, TRUNCATE = 1 << 0, 1 << 1, 1 << 2, 1 << 3, 1 << 14
#: number of kinds of access to files that each version of Landlock handles
KINDS = {1: 13, 2: 14, 3: 15, 4: 15}
KINDS_LATEST = 16
TCP_VERSION, SCOPE_VERSION = 4, 6
ALL_TCP = 0b11  #: binding and connecting
ALL_SCOPES = 0b11  #: abstract sockets and signals of other processes
OF_FILES = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE
#: what Python and its libraries read of the system; the processes' folder is not among it
SYSTEM = ("/usr", "/lib", "/lib64", "/etc", "/sys/devices/system", "/dev/urandom", "/dev/zero")

_libc = ctypes.CDLL(None, use_errno=True)


def version() -> int:
    """Landlock's version in this kernel; 0 where there is none."""
    if not sys.platform.startswith("linux"):
        return 0
    return max(0, int(_libc.syscall(CREATE_RULESET, None, 0, ASK_VERSION)))


def confine(reads: Iterable[Path], writes: Iterable[Path], lists: Iterable[Path] = ()) -> None:
    """From now on, read only below ``reads``, read and write only below ``writes``.

    Of folders below ``lists``, names may be read. Raises ``OSError``.
    """
    number = version()
    everything = (1 << KINDS.get(number, KINDS_LATEST)) - 1
    network = ALL_TCP if number >= TCP_VERSION else 0
    scopes = ALL_SCOPES if number >= SCOPE_VERSION else 0
    size = 24 if number >= SCOPE_VERSION else 16 if number >= TCP_VERSION else 8
    attributes = struct.pack("=QQQ", everything, network, scopes)[:size]
    rules = _call(CREATE_RULESET, attributes, size, 0)
    for paths, access in (
        (reads, READ_FILE | READ_DIR | EXECUTE),
        (writes, everything),
        (lists, READ_DIR),
    ):
        for path in paths:
            _allow(rules, path, access & everything)
    if _libc.prctl(SET_NO_NEW_PRIVILEGES, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "the kernel does not let privileges be given up")
    _call(RESTRICT_SELF, rules, 0)
    os.close(rules)


def _allow(rules: int, path: Path, access: int) -> None:
    if not path.exists():
        return
    at = os.open(path, os.O_PATH | os.O_CLOEXEC)
    try:
        if not path.is_dir():
            access &= OF_FILES
        _call(ADD_RULE, rules, PATH_BENEATH, struct.pack("=Qi", access, at), 0)
    finally:
        os.close(at)


def _call(number: int, *arguments: object) -> int:
    result = int(_libc.syscall(number, *arguments))
    if result < 0:
        error = ctypes.get_errno()
        raise OSError(error, f"Landlock: {os.strerror(error)}")
    return result


def end_with(parent: int) -> None:
    """End this process when its parent does, however that ends."""
    if sys.platform.startswith("linux"):
        _libc.prctl(SET_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        raise SystemExit("the proof that started this has ended")


def main() -> None:
    """Confine this process, then run a module as the program."""
    parser = argparse.ArgumentParser(prog="python -m bench.proof.confined")
    parser.add_argument("--parent", type=int, required=True)
    parser.add_argument("--read", type=Path, action="append", default=[])
    parser.add_argument("--write", type=Path, action="append", default=[])
    parser.add_argument("--list", type=Path, action="append", default=[])
    parser.add_argument("module")
    parser.add_argument("arguments", nargs="*")
    told = parser.parse_args()
    end_with(told.parent)
    if version():
        system = [*map(Path, SYSTEM), Path(sys.prefix), Path(sys.base_prefix)]
        confine([*system, *told.read], [*told.write, Path("/dev/null")], told.list)
    sys.argv = [told.module, *told.arguments]
    runpy.run_module(told.module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
