"""Threads of the tests: linear algebra has one per worker, as in the command line; several fight for the same cores.

On two cores with two workers, the dense least squares of tests/test_calibration.py took ten times as long otherwise.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
