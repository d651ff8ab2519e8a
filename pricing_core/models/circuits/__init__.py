"""Circuits with ideal diodes (11.2.1)."""
