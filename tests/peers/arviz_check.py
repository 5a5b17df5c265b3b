"""Reads a run with ArviZ, 1.x or 0.2x: its means are those of the draws, and it finds what it needs.

    pip install arviz xarray zarr
    oblate fit examples/tracks/s2_spherical.ecsv --config examples/quick_fit.toml --out runs/s2
    python tests/peers/arviz_check.py runs/s2
"""

import sys
import warnings
from pathlib import Path

warnings.filterwarnings("ignore", message=".*ArviZ is undergoing.*", category=FutureWarning)
import arviz
import xarray as xr

run = xr.open_datatree(Path(sys.argv[1]) / "posterior.zarr", engine="zarr")
data = run if int(arviz.__version__.split(".")[0]) >= 1 else arviz.InferenceData.from_datatree(run)
table = arviz.summary(data, var_names=["q", "log10_m_halo"])
print(f"ArviZ {arviz.__version__}")
print(table)
for name in table.index:
    mean = float(run["posterior"][name].mean())
    assert abs(float(table["mean"][name]) - mean) < 2e-3 * max(1.0, abs(mean))
assert {"lp", "ln_likelihood"} <= set(run["sample_stats"].data_vars)
