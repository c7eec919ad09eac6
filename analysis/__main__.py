"""The command ``chamfer``, also as ``python -m chamfer.analysis``.

Imports nothing before it waits for interrupts, so that one that comes early is one line too.
"""

import sys

_INTERRUPTED = 130  # exit status


def main() -> int:
    """Run the command line and return the exit status."""
    try:
        from chamfer.analysis.cli import main as run_command

        return run_command()
    except KeyboardInterrupt:
        print("chamfer: interrupted before anything was done", file=sys.stderr)
        return _INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
