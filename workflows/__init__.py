"""The studies of the paper, their shared parts, and the benchmarks of the library."""
