"""Options of the tests, and the renderer that several of them use."""

import sys
from pathlib import Path

import pytest

BINDINGS = Path(__file__).resolve().parents[1]
ROOT = BINDINGS.parents[1]
sys.path.insert(0, str(BINDINGS))

from tutorial import Penalty  # noqa: E402


def pytest_addoption(parser):
    parser.addoption("--program", type=Path, default=ROOT / "target/debug/stickslip", help="the program stickslip")


@pytest.fixture
def program(request):
    path = request.config.getoption("program").resolve()
    assert path.exists(), f"there is no {path}: build it with `cargo build`, or give --program"
    return path


@pytest.fixture
def penalty():
    return Penalty(50.0)
