"""``python -m chamfer.analysis.audit``: lists the fields of scenarios that change nothing."""

import argparse
import sys
import time
from collections.abc import Sequence

from chamfer.analysis.audit.contexts import CONTEXTS, EXEMPTIONS, Context
from chamfer.analysis.audit.field_audit import CRASH, KINDS, FieldVerdict, audit
from chamfer.analysis.campaign.campaign import parallel
from chamfer.analysis.campaign.progress import TerminalProgress
from chamfer.analysis.campaign.workers import cores
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.report.console import table
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue, select


def main(argv: Sequence[str] | None = None, *, catalogue: Catalogue = CATALOGUE) -> int:
    """Audit experiments and return the exit status: 1 if a field changes nothing."""
    parser = argparse.ArgumentParser(
        prog="python -m chamfer.analysis.audit",
        description="Perturbs each field of each experiment's scenario at reduced size and lists "
        "those that change nothing that is measured.",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="experiments (default: all)")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="settings",
        metavar="path=value",
        help="over the settings that reduce the size; repeat it for more",
    )
    parser.add_argument("--workers", type=int, default=cores(), help="processes (default: cores)")
    arguments = parser.parse_args(argv)
    started = time.perf_counter()
    try:
        entries = catalogue.entries
        chosen = select(entries, arguments.names) if arguments.names else entries
        with TerminalProgress("audit") as progress, parallel(arguments.workers):
            verdicts = audit(chosen, progress, contexts=CONTEXTS, settings=arguments.settings)
    except UserError as error:
        print(f"audit: {error}", file=sys.stderr)
        return 2
    print(report(verdicts, EXEMPTIONS))
    print(f"{time.perf_counter() - started:.0f} s")
    return 1 if any(is_wrong(verdict, EXEMPTIONS) for verdict in verdicts) else 0


def is_wrong(verdict: FieldVerdict, exemptions: Sequence[Context]) -> bool:
    """Return whether a verdict needs attention."""
    exempt = any(one.holds_for(verdict.experiment, verdict.path) for one in exemptions)
    crashed = any(CRASH in what for _, what in verdict.tried)
    return crashed or (verdict.kind in ("silent", "undecided") and not exempt)


def report(verdicts: Sequence[FieldVerdict], exemptions: Sequence[Context]) -> str:
    """Return a table of the experiments, the verdicts that need attention, and all attempts."""
    rows: list[tuple[str, ...]] = [("experiment", "fields", *KINDS, "CPU s")]
    for name in dict.fromkeys(verdict.experiment for verdict in verdicts):
        of_it = [verdict for verdict in verdicts if verdict.experiment == name]
        kinds = [verdict.kind for verdict in of_it]
        counts = (str(kinds.count(kind)) for kind in KINDS)
        seconds = sum(verdict.seconds for verdict in of_it)
        rows.append((name, str(len(of_it)), *counts, f"{seconds:.0f}"))
    lines = table(rows, right=range(1, len(rows[0])))
    for verdict in verdicts:
        if verdict.kind == "bounds":
            said = dict(reversed(verdict.tried))["bounds"]  # the first one
            lines.append(f"{verdict.experiment}: {verdict.path} only bounds: {said}")
    for verdict in verdicts:
        if is_wrong(verdict, exemptions):
            lines += ["", f"{verdict.experiment}: {verdict.path} is {verdict.kind}"]
            lines += [f"  {what}" for _, what in verdict.tried]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
