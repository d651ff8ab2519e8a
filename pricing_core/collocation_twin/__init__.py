"""Options with events, by collocation of their multiplier, in NumPy: function for function the compiled kernel.

Between two events V' = LV + u, 0 <= u _|_ V - g >= 0, in time s to the later event, has the solution
V(s) = e^{sL} V(0) + int_0^s e^{(s - s')L} u(s') ds' (variation of constants). On the contact set V = g, so there
u = (d/ds - L) g = r K - q S for a put, its negative for a call, and the contact set ends at one spot, the exercise
boundary. The first term is a Gaussian integral, the second one an integral over s' of normal distributions. What is
left to find is the boundary: a polynomial in the root of s such that V - g has slope 0 there at m + 1 Chebyshev times,
which is an implicit Runge-Kutta step of m stages over the whole stretch, with complementarity at every stage.
"""

from pricing_core.collocation_twin.solve import LEVELS, solve_schedules

__all__ = ["LEVELS", "solve_schedules"]
