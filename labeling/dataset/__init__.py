"""The dataset on disk: writes, reads, verifies and summarises it.

In come samples and what made them; out come files, and from these arrays, tables and summaries.

Knows nothing of how samples are generated.
"""
