"""When an option will be exercised, and what waiting costs."""
