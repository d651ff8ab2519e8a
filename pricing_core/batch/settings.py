"""What a table of contracts is priced with."""

from pricing_core.american.pricing_settings import PricingSettings

__all__ = ["PricingSettings"]
