"""Benchmarks: ratios of two things measured in the same run, printed as a table. Run with `python -m benchmarks`."""
