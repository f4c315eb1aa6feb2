"""Readers: a file, or several side by side, becomes a :class:`pinotwin.log.Log`."""

from pinotwin.logs.files.reading import LogLike as LogLike
from pinotwin.logs.files.reading import as_log as as_log
from pinotwin.logs.files.reading import as_logs as as_logs
from pinotwin.logs.files.reading import read as read
from pinotwin.logs.files.reading import read_argument as read_argument
