"""American options at volatility 0, and what they are worth.

Expected values: the closed formulas, as in QuantLib's edge-case test for American options.
"""

# Option type, spot, strike, expiry (years), rate, dividend yield, and the value.
OPTIMAL_STOPPING = [
    ("call", 100.0, 50.0, 1.0, 0.05, 0.01, 51.4435121498811085),  # held to expiry
    ("put", 100.0, 120.0, 40.0, 0.01, 0.5, 108.980904561184602),  # best time between
    ("put", 100.0, 120.0, 1.0, 0.05, 0.01, 20.0),  # exercised now
    ("put", 100.0, 120.0, 1.0, 0.0, 0.05, 24.8770575499286082),
    ("call", 100.0, 1e-7, 1.0, 0.05, 0.025, 100.0 - 1e-7),
    ("put", 0.0, 120.0, 1.0, -0.075, 0.05, 129.346098106155779),
    ("call", 0.0, 120.0, 1.0, 0.075, 0.05, 0.0),
]
