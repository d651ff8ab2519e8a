"""From volatilities to a surface without arbitrage, and to a local volatility that reprices the quotes."""
