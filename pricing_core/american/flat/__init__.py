"""Constant rates, yield and volatility: formulas, the march of the early exercise premium, and the method of lines."""
