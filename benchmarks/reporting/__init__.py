"""What a benchmark reports, and the files that it is written to."""
