"""The search for causes: scan all candidates, polish the best, take in one after the other."""
