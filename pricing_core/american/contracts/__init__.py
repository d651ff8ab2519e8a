"""What is priced: options, markets, their dates and dividends, and the schedule of events they make."""
