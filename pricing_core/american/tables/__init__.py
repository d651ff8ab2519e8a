"""Tables of contracts: columns in, checked rows out."""
