"""Tables of contracts: a CSV or Parquet file in, the same rows with their values out."""

from pricing_core.extras import needs_extra

with needs_extra("batch"):
    from pricing_core.batch.price_table import price_table
    from pricing_core.batch.runner import BatchSummary, Progress, rejects_path, run_batch

__all__ = ["BatchSummary", "Progress", "price_table", "rejects_path", "run_batch"]
