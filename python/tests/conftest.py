"""Tracks, points and the command, for all tests."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import oblate

ROOT = Path(__file__).parents[2]
TRACK = ROOT / "examples" / "tracks" / "s2_spherical.ecsv"
QUICK_FIT = ROOT / "examples" / "quick_fit.toml"


@pytest.fixture(scope="session")
def fit() -> oblate.Fit:
    """All thirteen parameters are free."""
    return oblate.Fit(TRACK)


@pytest.fixture(scope="session")
def points(fit: oblate.Fit) -> np.ndarray:
    """Two points with a stream near the track."""
    lines = (ROOT / "examples" / "points.jsonl").read_text().splitlines()
    return np.array([[json.loads(line)[name] for name in fit.names] for line in lines])


@pytest.fixture(scope="session")
def command():
    """Runs the command `oblate` and returns its output."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    program = target / "release" / "oblate"
    assert program.is_file(), f"{program} is missing: run `cargo build --release` first"

    def run(*arguments: object, given: str = "", check: bool = True) -> str:
        words = [str(program), *map(str, arguments)]
        return subprocess.run(words, input=given, capture_output=True, text=True, check=check).stdout

    return run
