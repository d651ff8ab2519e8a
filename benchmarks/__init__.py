"""Benchmarks: each module asks one question and answers it; the folders hold what the modules are made of."""
