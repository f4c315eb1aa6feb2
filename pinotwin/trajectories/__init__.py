"""Commands: moves of machines within their limits, for virtual machines and as advice for real ones."""
