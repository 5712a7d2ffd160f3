"""Every test."""

import signal


def pytest_configure() -> None:
    """Have programs that tests start hear of a closed terminal, also where pytest does not."""
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:  # as under nohup
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
