"""Benchmarks of depthwarp next to what a user would otherwise pick: see README.md."""
