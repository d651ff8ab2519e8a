"""The HTTP service: from bytes on a socket to answers and problems; the routes are in `routes`."""
