"""The parts of `benchmarks.engine_frontier`: what is measured of the option engine, its goals, and the report."""
