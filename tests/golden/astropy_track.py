"""Writes astropy_track.ecsv: a track as an astronomer would save it, with quantities in arcsec and a distance."""

import sys

import numpy as np
import astropy.units as u
from astropy.table import QTable

phi = np.array([-35.0, -25.0, -15.0, 5.0, 15.0, 25.0]) * u.deg
r_kpc = 60.0 + 0.2 * phi.value + 0.004 * phi.value**2
distance = 20.0 * u.Mpc
table = QTable(
    {
        "phi": phi,
        "r": (r_kpc * u.kpc / distance * u.rad).to(u.arcsec),
        "r_err": (0.03 * r_kpc * u.kpc / distance * u.rad).to(u.arcsec),
        "n": np.array([110, 140, 320, 300, 150, 120]),
    },
    meta={"name": "NGC 0000 south", "distance": distance, "origin": "made by astropy_track.py"},
)
table.write(sys.argv[1], format="ascii.ecsv", overwrite=True)
