"""The dataset on disk: writes, reads, verifies and summarises it.

Knows nothing of how samples are generated.
"""
