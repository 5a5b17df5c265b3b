"""Reads a nested run with anesthetic, which weighs it from births and deaths alone: both must come to one ln Z
and the same medians.

    pip install anesthetic xarray zarr
    oblate fit examples/tracks/s2_spherical.ecsv --config examples/quick_fit.toml --sampler nested --out runs/s2_nested
    python tests/peers/anesthetic_check.py runs/s2_nested
"""

import json
import sys
import warnings
from pathlib import Path

import anesthetic
import numpy as np
import xarray as xr

warnings.filterwarnings("ignore", message=".*[Cc]onsolidated.*")

folder = Path(sys.argv[1])
summary = json.loads((folder / "summary.json").read_text())
zarr = folder / "posterior.zarr"
history = xr.open_zarr(zarr, group="history")
weighted = xr.open_zarr(zarr, group="weighted")
names = list(summary["parameters"])

# Rejected points have no likelihood and no row of parameters, but they were alive.
ln_l = history["ln_likelihood"].values
theta = np.full((ln_l.size, len(names)), np.nan)
theta[np.isfinite(ln_l)] = weighted["theta"].values
# Points born above rejected ones have the smallest number as birth, so that is where those died; anesthetic wants another, below
# all others but not as far.
birth = history["ln_likelihood_birth"].values
lowest = ln_l[np.isfinite(ln_l)].min() - 1.0
birth = np.where(birth == np.finfo(float).min, lowest, birth)
samples = anesthetic.NestedSamples(
    data=np.nan_to_num(theta),
    columns=names,
    logL=np.maximum(ln_l, lowest),
    logL_birth=birth,
)
ln_z, error = float(samples.logZ()), float(samples.logZ(200).std())
ours, our_error = summary["ln_z"]["value"], summary["ln_z"]["error"]
print(f"oblate     {ours:.3f} +- {our_error:.3f}")
print(f"anesthetic {ln_z:.3f} +- {error:.3f}")
assert abs(ours - ln_z) < 0.2 * our_error
for name in names:
    row = summary["parameters"][name]
    median = float(samples[name].quantile(0.5))
    print(f"{name:>16} {row['median']:10.4f} {median:10.4f}")
    # The same draws, with weights of the same volumes: the step from one draw to the next is all that they may differ by.
    assert abs(row["median"] - median) < 0.05 * (row["hi68"] - row["lo68"]), name
