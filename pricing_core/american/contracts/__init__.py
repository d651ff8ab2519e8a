"""What is priced: options, markets, their dates and dividends."""
