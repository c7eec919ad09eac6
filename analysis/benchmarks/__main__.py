"""``python -m chamfer.analysis.benchmarks``, on one BLAS thread.

On matrices this small a second thread only spins: python-control takes the same time without it,
and twice as long with it when another process has the second core.
"""

import os
import sys
from typing import Final

THREADS: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

if __name__ == "__main__":
    os.environ.update(dict.fromkeys(THREADS, "1"))  # NumPy reads these when it is loaded
    from chamfer.analysis.benchmarks.benchmark_report import main

    sys.exit(main())
