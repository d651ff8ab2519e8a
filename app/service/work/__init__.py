"""Which work is admitted, where it runs, and what bounds it: cost, lanes, deadlines and limits of a client."""
