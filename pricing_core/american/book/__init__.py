"""Contracts in columns, the prices that belong to them, and the tables that hold both."""
