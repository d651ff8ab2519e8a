"""The parts of `benchmarks.lcs_work_precision`: systems whose states are known, and what is measured on them."""
