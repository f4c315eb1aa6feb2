"""Readers: a file, or several side by side, becomes a :class:`pinotwin.log.Log`."""

from pinotwin.files.reading import read as read
from pinotwin.files.reading import read_argument as read_argument

__all__ = ["read", "read_argument"]
