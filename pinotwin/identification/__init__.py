"""Identification: from a machine and its logs to a twin."""

from __future__ import annotations

from pinotwin.identification.pipeline import identify
from pinotwin.identification.settings import Settings

__all__ = ["Settings", "identify"]
