"""The machinery: from a scenario to a run, its results and the report; it knows no subject."""
