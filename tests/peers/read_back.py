"""Opens what oblate wrote with the tools of its users: arviz and xarray (posterior.zarr), astropy (ECSV).

    pip install astropy arviz xarray zarr
    OBLATE_FIGURES=/tmp/kept cargo test --test integration -- to_the_bit
    python tests/peers/read_back.py /tmp/kept/n.zarr /tmp/kept/t.zarr /tmp/kept/track.ecsv
"""

import sys
import warnings

import numpy as np

warnings.filterwarnings("ignore", message=".*[Cc]onsolidated.*")

for path in sys.argv[1:]:
    if path.endswith(".zarr"):
        import arviz as az
        import xarray as xr

        posterior = xr.open_zarr(path, group="posterior")
        print(path, "xarray:", dict(posterior.sizes), "units of x0_kpc:", posterior["x0_kpc"].attrs["units"])
        assert posterior["q"].dims == ("chain", "draw")
        weighted = xr.open_zarr(path, group="weighted")
        weights = np.exp(weighted["ln_weight"].values)
        assert abs(weights.sum() - 1.0) < 1e-9
        try:
            tree = az.from_zarr(path)
        except ImportError:
            # ArviZ before 1.0 refuses zarr >= 3 by name and asks for this way in.
            tree = az.InferenceData.from_datatree(xr.open_datatree(path, engine="zarr"))
        print(path, "arviz groups:", tree.groups() if callable(tree.groups) else tree.groups)
        print(az.summary(tree, var_names=["age_gyr", "q"]))
        assert abs(float(tree["posterior"]["q"].mean()) - 0.8) < 0.05
    else:
        from astropy.table import QTable

        table = QTable.read(path, format="ascii.ecsv")
        print(path, "astropy:", table.colnames, [str(c.unit) for c in table.itercols()], dict(table.meta))
        assert (np.diff(table["phi"].to_value("deg")) > 0).all() and table["r"].unit == "kpc"
print("all read back")
