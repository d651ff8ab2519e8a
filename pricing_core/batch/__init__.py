"""Tables of contracts: a CSV or Parquet file in, the same rows with their values out."""

from pricing_core.extras import needs_extra

with needs_extra("batch"):
    from pricing_core.batch.csv_check import TextCheck
    from pricing_core.batch.price_table import price_table
    from pricing_core.batch.runner import BatchSummary, Progress, parts_path, rejects_path, run_batch

__all__ = ["BatchSummary", "Progress", "TextCheck", "parts_path", "price_table", "rejects_path", "run_batch"]
