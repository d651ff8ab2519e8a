"""The parts of `benchmarks.frozen_results`: the random contracts, the comparison of two files, and its report."""
