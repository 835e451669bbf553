"""``python -m benchmarks [--json] [--quick] [--only NAME]``."""

from __future__ import annotations

import os

# Before NumPy is imported: single-threaded rows are to be so throughout.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse  # noqa: E402
import sys  # noqa: E402
from contextlib import redirect_stdout  # noqa: E402

from benchmarks import report, suite  # noqa: E402


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Times of leastaction, beside its targets."
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout, nothing else")
    parser.add_argument("--quick", action="store_true", help="a few seconds: short problems, which have no targets")
    parser.add_argument(
        "--only",
        action="append",
        choices=sorted(suite.GROUPS),
        metavar="NAME",
        help=f"only this group, may be given again: {', '.join(suite.GROUPS)}",
    )
    arguments = parser.parse_args()
    # Whatever a library prints while it is measured does not belong to the result.
    with redirect_stdout(sys.stderr):
        measured = suite.run(quick=arguments.quick, only=arguments.only, progress=report.progress(sys.stderr))
    if arguments.json:
        print(report.as_json(measured))
    else:
        report.print_table(measured)
    return 0


if __name__ == "__main__":
    sys.exit(main())
