"""Measuring: the time that calls take, the machine they run on, and the time that a method needs for an accuracy."""
