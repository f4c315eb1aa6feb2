"""Everything about logs: reading files, naming channels, judging and preparing them."""
