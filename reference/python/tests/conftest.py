"""The `within` fixture: an assertion that keeps its residual, and the table of all residuals at the end of the run."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

RESIDUALS = pytest.StashKey[list]()


def pytest_addoption(parser):
    parser.addoption("--residuals", metavar="FILE", help="write quantity, tolerance and measured residual as JSON")


def pytest_configure(config):
    config.stash[RESIDUALS] = []


@pytest.fixture
def within(request):
    """within(quantity, residual, tolerance): fails unless residual <= tolerance, so also on NaN.

    The residual is a number, or several of which the largest counts. Python's `max` may lose a NaN among them.
    """
    def check(quantity, residual, tolerance):
        residual = float(np.max(residual))
        request.config.stash[RESIDUALS].append(
            {"test": request.node.nodeid.split("/")[-1], "quantity": quantity, "tolerance": tolerance, "residual": residual})
        assert residual <= tolerance, f"{quantity}: {residual:.3e} is not within {tolerance:.1e}"
    return check


def pytest_terminal_summary(terminalreporter, config):
    rows = config.stash[RESIDUALS]
    if not rows:
        return
    worst = {}
    for row in rows:
        key = row["test"].split("::")[0], row["quantity"], row["tolerance"]
        worst[key] = np.maximum(worst.get(key, row["residual"]), row["residual"])
    terminalreporter.section("largest residuals")
    for (file, quantity, tolerance), residual in worst.items():
        terminalreporter.write_line(f"{file:<24} {quantity:<58} {residual:10.2e} of {tolerance:.1e}")
    if config.getoption("--residuals"):
        Path(config.getoption("--residuals")).write_text(json.dumps(rows, indent=1) + "\n")
