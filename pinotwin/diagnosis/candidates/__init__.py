"""Candidates: the effects of the catalogue, and patterns that have no name in it."""
