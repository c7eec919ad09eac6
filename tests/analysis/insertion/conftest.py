"""A quick insertion in the cell: close, nearly aligned, fast, not deep."""

import pytest

from chamfer.analysis.insertion.cell_runs import CellInsertion, run_cell_insertion
from chamfer.diagrams.insertion.insertion import InsertionScenario, resolve
from chamfer.systems.strategies.insertion_chart import InsertParams


@pytest.fixture(scope="session")
def quick() -> InsertionScenario:
    """A second of simulation, if all is well."""
    return InsertionScenario(
        initial_error=(0.0, 0.001, -0.001, 0.0, 0.01, -0.01),
        begin=0.2,
        gap=0.012,
        insert=InsertParams(depth=0.02, speed=0.06, rest=0.1, attempts=1),
        duration=8.0,
    )


@pytest.fixture(scope="session")
def done(quick: InsertionScenario) -> CellInsertion:
    """The quick one's run."""
    return run_cell_insertion(resolve(quick), seed=0)
