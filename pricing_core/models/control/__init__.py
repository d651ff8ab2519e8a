"""The parts of optimal control with state constraints: collocation, structure, arcs, shooting."""
