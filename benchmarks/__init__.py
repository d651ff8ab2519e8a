"""Benchmarks: each asks one question and answers it with a report of tables and figures."""
