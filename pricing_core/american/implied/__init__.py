"""From prices back to what they imply: volatilities, and the carry of a chain."""
