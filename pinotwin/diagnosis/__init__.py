"""Diagnosis of the gap between a log and its model."""
