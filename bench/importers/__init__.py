"""Other people's logs as recordings.

A format is told by the shape of a file, not by whose it is. :func:`import_file` reads one foreign
file; :func:`open_recordings` takes paths of any kind, the project's own recordings too.
"""

from .opening import import_file, open_recordings
from .shapes import FORMATS, recognise

__all__ = ["FORMATS", "import_file", "open_recordings", "recognise"]
