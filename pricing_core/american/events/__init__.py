"""Dividends, curves, exercise dates: collocation of the multiplier, and the method of lines between events."""
