"""Tables of contracts held by Apache Arrow, and frames that pass their columns as Arrow does."""
