"""Netlists in SPICE's language: lines, parameters, subcircuits, models and elements."""
