"""The service and the command line on top of the library."""
