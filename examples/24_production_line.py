"""Plan a production line: what sets its pace, what another pallet is worth, and when to start for given due times.

A saw, a drill and a press work one after the other on pieces that travel on pallets; a pallet goes back to the
saw when its piece leaves the press. Times are in minutes.

Run it from the root of the project: .venv/bin/python examples/24_production_line.py
"""

from pathlib import Path

import numpy as np

from app.commands.max_plus_plots import gantt
from pricing_core import max_plus as mp

PLOT = Path(__file__).parent / "out" / "24_production_line.png"


def line(pallets: int) -> mp.TimedEventGraph:
    """Return the line: each transition is the start of an operation, or the piece's way out."""
    return mp.read_event_graph(f"""
        saw   -> drill: 5          # 4 to saw, 1 to carry
        drill -> press: 7          # 6 to drill, 1 to carry
        press -> out:   3
        out   -> saw:   3, {pallets}   # the pallet goes back
        saw   -> saw:   4, 1       # each machine takes one piece at a time
        drill -> drill: 6, 1
        press -> press: 3, 1
        output out
    """)


print("pallets  minutes per piece  bottleneck")
for pallets in (1, 2, 3, 4):
    plan = line(pallets)
    print(f"{pallets:7}  {plan.cycle_time():17g}  {' -> '.join(plan.critical_circuit())}")

# With three pallets the drill is the bottleneck: more pallets would only wait in front of it.
plan = line(3)
print(f"pieces per hour with three pallets: {60 * plan.throughput():g}")

assert [line(k).cycle_time() for k in (1, 2, 3, 4)] == [
    18.0,
    9.0,
    6.0,
    6.0,
]  # 18 minutes a round, 6 at the drill

# Just in time: orders are due at these minutes. The latest starts of the saw that meet them all:
feed = mp.TimedEventGraph(
    ["order", *plan.transitions],
    [mp.Place("order", "saw"), *plan.places],
    inputs=["order"],
    outputs=["out"],
)
due = np.array([[np.inf], [30.0], [34.0], [50.0], [58.0]])
starts = mp.just_in_time(feed.state_space(), due)
for number, (start, done, asked) in enumerate(
    zip(starts.u[:, 0], starts.y[1:, 0], due[1:, 0], strict=True), 1
):
    print(f"piece {number}: start at {start:4.1f}, done at {done:4.1f}, due at {asked:4.1f}")
assert np.all(starts.y[1:, 0] <= due[1:, 0])

PLOT.parent.mkdir(exist_ok=True)
gantt(plan, plan.run(5).x, unit="minutes").savefig(PLOT, dpi=110)
