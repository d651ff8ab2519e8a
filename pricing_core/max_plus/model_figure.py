"""The picture of a model's run; imports matplotlib."""

from matplotlib.figure import Figure

from pricing_core.max_plus.figures import gantt, orbit
from pricing_core.max_plus.model_file import ModelRun

LARGEST_GANTT = 40  # firings that can still be told apart


def draw_model_run(run: ModelRun) -> Figure:
    """Draw a Gantt chart for an event graph of few firings, else the times of all states against their number."""
    if run.graph is not None and len(run.table) <= LARGEST_GANTT + 1:
        return gantt(run.graph, run.states)
    names = run.columns[1 : 1 + run.state_count]
    return orbit(run.states, names, rate=float(run.cycle_time.max()))
