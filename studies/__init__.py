"""A whole run as one file: reading, running and sweeping studies, the bundled ones, and both papers' experiments."""
