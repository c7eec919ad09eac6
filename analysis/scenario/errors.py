"""The errors that the command line says in one line, without a traceback."""


class UserError(Exception):
    """A mistake in what was asked for.

    The message names the thing, its value and what would have been valid.
    """


class ExperimentError(Exception):
    """An experiment ended before it had a result; the message names it and says why."""
