"""Reads a run with getdist and with corner: both must come to the intervals of its summary from the weighted draws.

    pip install corner getdist xarray zarr
    oblate fit examples/tracks/s2_spherical.ecsv --config examples/quick_fit.toml --sampler nested --out runs/s2_nested
    python tests/peers/getdist_corner_check.py runs/s2_nested
"""

import json
import sys
from pathlib import Path

import corner
import getdist
import matplotlib
import numpy as np
import xarray as xr

matplotlib.use("agg")

folder = Path(sys.argv[1])
summary = json.loads((folder / "summary.json").read_text())
weighted = xr.open_zarr(folder / "posterior.zarr", group="weighted")
names = list(summary["parameters"])
theta, weights = weighted["theta"].values, np.exp(weighted["ln_weight"].values)

samples = getdist.MCSamples(samples=theta, weights=weights, loglikes=-weighted["ln_likelihood"].values, names=names)
figure = corner.corner(theta, weights=weights, labels=names)
assert len(figure.axes) == len(names) ** 2

for k, name in enumerate(names):
    ours = summary["parameters"][name]
    quantiles = corner.quantile(theta[:, k], [0.16, 0.5, 0.84], weights=weights)
    by_getdist = [samples.confidence(name, 0.16), samples.confidence(name, 0.5), samples.confidence(name, 0.16, upper=True)]
    expected = [ours["lo68"], ours["median"], ours["hi68"]]
    print(f"{name:>16}", *(f"{x:10.4f}" for x in (*expected, *quantiles, *by_getdist)))
    width = ours["hi68"] - ours["lo68"]
    assert np.allclose(quantiles, expected, atol=0.05 * width), "corner"
    assert np.allclose(by_getdist, expected, atol=0.05 * width), "getdist"
print("getdist and corner agree with the summary")
