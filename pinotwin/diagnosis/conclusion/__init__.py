"""The conclusion: gaps before and after, where they lie, what is named with what confidence, what to do."""
