"""QuantLib's engines on this library's contracts (extra [bench])."""
