"""`POST /v1/batch`: columns, lines or Arrow in, prices of every row out."""
