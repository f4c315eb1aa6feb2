"""Readers: a file, or several side by side, becomes a :class:`pinotwin.log.Log`."""

from pinotwin.logs.files.reading import read as read
from pinotwin.logs.files.reading import read_argument as read_argument
