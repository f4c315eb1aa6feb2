"""The evidence for a candidate: block sums, held-out gains, differences of differences."""
