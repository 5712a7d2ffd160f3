"""Collecting accesses while a loop runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .accesses import AccessRows
from .recording import Recording


class Recorder(AccessRows):
    """Keeps accesses in memory; give it as the callback of a bus client.

    Nothing touches a disk before :func:`bench.recording.write`.
    """

    def recording(self, metadata: Mapping[str, Any]) -> Recording:
        """Make a recording of all accesses so far; adds ``format`` to ``metadata`` if missing.

        The recorder stays as it is and can go on. Raises :class:`RecordingError`.
        """
        return Recording.of(self, metadata)
