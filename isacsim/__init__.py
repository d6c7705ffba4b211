"""From a scenario to what the network knows of its vehicles: traffic, echoes, fixes and tracks. Labels are unknown.

Importing it makes idle OpenMP threads sleep instead of spin. A spinning team of two threads on two cores makes training
several times slower as soon as anything else runs; docs/performance.md says what sleeping costs on an idle machine.
OpenMP reads the variable once, when it is loaded, so this comes before the first import of torch or scikit-learn. A
value that the user has set is kept.
"""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
