"""Everything about logs: reading files, naming channels, judging and preparing them."""

from pinotwin.logs.settings import Settings as Settings
