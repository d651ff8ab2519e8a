"""The service under load: servers, clients, and batches."""
