"""`POST /v1/chain`: quotes of one underlying in, the tables of their fit out."""
