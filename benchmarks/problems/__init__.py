"""The contracts that the benchmarks of the option engine price, and true values from an integral equation."""
