"""Tables of contracts: a CSV or Parquet file in, the same rows with their values out."""

from __future__ import annotations

from pricing_core.extras import needs_extra

with needs_extra("batch"):
    from pricing_core.batch.csv_check import TextCheck
    from pricing_core.batch.explain import explain_profit_and_loss
    from pricing_core.batch.price_table import price_table
    from pricing_core.batch.runner import BatchSummary, Progress, parts_path, rejects_path, run_batch
    from pricing_core.batch.scenario import Scenario, read_scenarios, scenarios_of
    from pricing_core.batch.scenario_files import ScenarioSummary, run_explain, run_scenarios
    from pricing_core.batch.scenarios import value_scenarios

__all__ = [
    "BatchSummary",
    "Progress",
    "Scenario",
    "ScenarioSummary",
    "TextCheck",
    "explain_profit_and_loss",
    "parts_path",
    "price_table",
    "read_scenarios",
    "rejects_path",
    "run_batch",
    "run_explain",
    "run_scenarios",
    "scenarios_of",
    "value_scenarios",
]
