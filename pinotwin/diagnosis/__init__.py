"""Diagnosis of the residual between a log and its model."""

from __future__ import annotations

from pinotwin.diagnosis.pipeline import diagnose as diagnose
from pinotwin.diagnosis.result import Diagnosis as Diagnosis

__all__ = ["Diagnosis", "diagnose"]
