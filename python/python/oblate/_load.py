"""Run folders as trees of labelled arrays."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from oblate._oblate import Run


def load(folder: str | os.PathLike[str]) -> Any:
    """The `posterior.zarr` of a finished run as an `xarray.DataTree`: what ArviZ 1.0 and later works with.

    Groups: `posterior` (draws of equal weight), `sample_stats`, `observed_data`, `prior`, `weighted` (the sampler's own draws)
    and `history`; docs/files.md, section 6. Needs xarray and zarr.
    """
    # The library says what is wrong with a folder that is no finished run, or is damaged.
    Run.read(folder)
    import xarray

    return xarray.open_datatree(Path(folder) / "posterior.zarr", engine="zarr")


def load_arviz(folder: str | os.PathLike[str]) -> Any:
    """A finished run as the installed ArviZ takes it: an `InferenceData` before 1.0, an `xarray.DataTree` since."""
    import arviz

    tree = load(folder)
    if hasattr(arviz, "InferenceData"):
        return arviz.InferenceData.from_datatree(tree)
    return tree
