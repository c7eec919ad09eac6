"""Scenarios on disk: those that a user writes, and those that lie with the results."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.report.results import read_result
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_yaml import read_mapping

_RESULT_ENDING: Final = ".json"


def read_scenario(path: Path, experiment: str) -> Mapping[Any, Any]:
    """Return the fields that a file gives: a YAML file of fields, or a result of the experiment.

    Raises:
        UserError: If the file can't be read, is neither of them, or is a result of another
            experiment.
    """
    if path.suffix != _RESULT_ENDING:
        return read_mapping(path)
    try:
        result = read_result(path)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror or error}") from error
    except ValueError as error:
        raise UserError(f"{path} is not a result: {error}") from error
    scenario = result.get("scenario")
    if not isinstance(scenario, dict):
        raise UserError(f"{path} is not a result: it has no scenario")
    of = result.get("experiment", result.get("design"))
    if of != experiment:
        raise UserError(f"{path} is a result of {of}, not of {experiment}")
    return scenario
