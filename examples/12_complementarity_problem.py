"""Solve linear complementarity problems: two unknowns, one without a solution, and a membrane over an obstacle.

A linear complementarity problem asks for z with w = q + M z and 0 <= z _|_ w >= 0.

Run it from the root of the project: .venv/bin/python examples/12_complementarity_problem.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy import sparse

from pricing_core.errors import InfeasibleError
from pricing_core.lcp import LCP, is_p_matrix, solve

# A P-matrix: exactly one solution for every q (theorem 11.1 rests on it).
M, q = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-5.0, -6.0])
found = solve(LCP(M, q))
print(f"z = {found.z}, w = {found.w}, by {found.method}; P-matrix: {is_p_matrix(M)}")
assert np.allclose(found.z, [4.0 / 3.0, 7.0 / 3.0], atol=1e-15)

# w = -1 - z is never >= 0 for z >= 0, and the solver says so with a proof.
try:
    solve(LCP([[-1.0]], [-1.0]))
except InfeasibleError as refused:
    print(f"refused: {refused}")
else:
    raise AssertionError("an infeasible problem was solved")

# A membrane is pressed down onto a ball: minus its Laplacian less the load is the contact force, 128 x 128 unknowns.
n = 128
x = np.linspace(-1.0, 1.0, n + 2)[1:-1]
second = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)) / (x[1] - x[0]) ** 2
laplacian = sparse.kronsum(second, second, format="csr")
ball = (0.5 - x[:, None] ** 2 - x[None, :] ** 2).ravel()
contact = solve(LCP(laplacian, laplacian @ ball))  # z = u - ball, w = -Laplacian u
u = contact.z + ball
touching = contact.w > 1e-9
print(
    f"membrane: {n * n} unknowns by {contact.method}, residual {contact.residual:.0e}, {touching.mean():.1%} touch"
)

# Where it touches, its height is known; outside it is harmonic and symmetric, whatever the grid.
height = u.reshape(n, n)
assert np.allclose(height, height.T, atol=1e-9)
assert np.allclose(height, height[::-1], atol=1e-9)
assert np.all(contact.z >= 0.0)
assert np.max(np.minimum(contact.z, contact.w)) < 1e-8

figure = Figure(figsize=(6.0, 5.0), layout="constrained")
axes = figure.subplots(subplot_kw={"projection": "3d"})
axes.plot_surface(x[:, None], x[None, :], height, cmap="viridis", linewidth=0, rcount=64, ccount=64)
axes.set(title="A membrane over a ball", zlabel="height", box_aspect=(1, 1, 0.5))
target = Path(__file__).parent / "out" / "12_complementarity_problem.png"
target.parent.mkdir(exist_ok=True)
figure.savefig(target, dpi=120)
