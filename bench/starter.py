"""Processes that end with the one that started them, however that ends."""

from __future__ import annotations

import os
import threading
import time

WATCH_S = 1.0  #: how often a process looks whether the one that started it is still there


def end_with_starter(starter: int) -> None:
    """From now on, end this process soon after its parent, the process ``starter``, has ended."""

    def watch() -> None:
        while os.getppid() == starter:
            time.sleep(WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
