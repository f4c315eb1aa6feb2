"""Benchmarks: ``make bench`` runs them, each beside its peers."""
