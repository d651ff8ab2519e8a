"""Design a railway timetable: which minutes past the hour, how much slack, and how long a delay is felt.

Two cities are joined by a line with trains both ways; each city has a ring line of its own for its suburbs. At
each station the trains wait for each other, so that passengers can change. Times are in minutes.

The line takes 58 and 54 minutes, the rings 41 and 50; changing takes 2. Two trains serve the line, and one each ring.

Run it from the root of the project: .venv/bin/python examples/25_railway_timetable.py
"""

from pathlib import Path

import numpy as np

from app.commands.max_plus_plots import gantt
from pricing_core import max_plus as mp

PERIOD = 60.0  # minutes between trains in the timetable
PLOT = Path(__file__).parent / "out" / "25_railway_timetable.png"

# A departure waits for the trains that arrive: running time plus 2 minutes to change; one token is one train.
network = mp.TimedEventGraph(
    ["west", "west ring", "east", "east ring"],
    [
        ("west", "east", 60.0, 1),
        ("west", "east ring", 60.0, 1),
        ("east", "west", 56.0, 1),
        ("east", "west ring", 56.0, 1),
        ("west ring", "west ring", 43.0, 1),
        ("west ring", "west", 43.0, 1),
        ("east ring", "east ring", 52.0, 1),
        ("east ring", "east", 52.0, 1),
    ],
)
A = network.state_space().A

print(f"shortest period {network.cycle_time():g} minutes, set by {' and '.join(network.critical_circuit())}")
print(f"slack per hour  {PERIOD - network.cycle_time():g} minutes")

# The eigenvector of the fastest timetable is a timetable: departures in minutes past the first of them.
departures = mp.eigenvector(A)
for name, minute in zip(network.transitions, departures - departures.min(), strict=True):
    print(f"departs {minute:4.1f} past: {name}")

# One train leaves 10 minutes late. With d(k) = max(departure, what the others let it be) the delay dies out.
planned = departures - departures.min()
late = planned + np.array([10.0, 0.0, 0.0, 0.0])
hours = 0
while (late > planned + 1e-9).any():
    hours += 1
    planned = planned + PERIOD
    late = np.maximum(planned, mp.multiply(A, late))
print(f"10 minutes late at west are felt for {hours} hours")
assert network.cycle_time() == 58.0  # two trains serve 60 + 56 minutes
assert hours == 5  # 10 minutes late, and 2 minutes of slack an hour

PLOT.parent.mkdir(exist_ok=True)
gantt(network, network.run(4, start=departures - departures.min()).x, unit="minutes").savefig(PLOT, dpi=110)
