"""From a scenario to what the network knows of its vehicles: traffic, echoes, fixes and tracks. Labels are unknown.

Importing it sets two environment variables, each of which a library reads once, so it comes before the first import of
torch or scikit-learn. Values that the user has set are kept. docs/performance.md says what both are worth.

- Idle OpenMP threads sleep instead of spin. A spinning team of two threads on two cores makes training several times
  slower as soon as anything else runs.
- PyTorch asks for huge pages. A training step allocates a hundred megabytes anew, and a page fault for every 4 kB of
  them takes a fifth of its time.
"""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")
