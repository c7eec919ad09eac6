"""``python -m chamfer.analysis.benchmarks``."""

import os
import sys
from typing import Final

_THREADS: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def start() -> int:
    """Run the benchmark on one BLAS thread and return the exit status.

    On matrices this small a second thread only spins: python-control takes the same time without
    it, and twice as long with it when another process has the second core.
    """
    environment = dict(os.environ)
    # NumPy reads these when it is loaded.
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    from chamfer.analysis.benchmarks.benchmark_report import main

    return main(environment=environment)


if __name__ == "__main__":
    sys.exit(start())
