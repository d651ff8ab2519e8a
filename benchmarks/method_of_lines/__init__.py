"""The parts of `benchmarks.crank_nicolson`: the stepping methods, what is measured of them, and the report."""
