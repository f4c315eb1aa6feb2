"""Identification: from a machine and its logs to a twin."""

from __future__ import annotations

from pinotwin.identification.pipeline import identify

__all__ = ["identify"]
