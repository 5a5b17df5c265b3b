#!/usr/bin/env python3
"""Make mass_loss.json: releases by gala from a progenitor that loses mass.

    python mass_loss.py        -> mass_loss.json (a minute on one core)

The progenitor moves in the spherical NFW halo of the stream s2_spherical of gala_streams.py and has the mass m (1 - (1 - left) s) or
m left^s, where s is the time since the first release over the age. gala's FardalStreamDF takes this mass at each time. At nine times
N particles of each tail are released, and their mean distance from the progenitor along the outward direction is recorded.
Units: kpc, Gyr, Msun.
"""
import json

import astropy.units as u
import gala.dynamics as gd
import gala.potential as gp
import numpy as np
from gala.dynamics.mockstream import FardalStreamDF
from gala.units import UnitSystem

from gala_streams import STREAMS

N = 40_000
STEPS = 4_000
LEFT = 0.2
TIMES = [0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 0.98]
# gala's own constant of gravity belongs to these units.
UNITS = UnitSystem(u.kpc, u.Gyr, u.Msun, u.rad)

s = STREAMS[2]
host = gp.NFWPotential(m=10 ** s["log10M"] * u.Msun, r_s=s["Rs"] * u.kpc, units=UNITS)
today = gd.PhaseSpacePosition(pos=list(s["x"]) * u.kpc, vel=list(s["v_kms"]) * u.km / u.s)
orbit = gp.Hamiltonian(host).integrate_orbit(
    today, dt=-s["T"] / STEPS * u.Gyr, n_steps=STEPS, Integrator="dop853")
orbit = orbit[::-1]
since = np.linspace(0, 1, STEPS + 1)
laws = {"linear": s["m"] * (1 - (1 - LEFT) * since), "exponential": s["m"] * LEFT ** since}
rows = []
for law, mass in laws.items():
    for k, time in enumerate(TIMES):
        at = int(round(time * STEPS))
        number = np.zeros(STEPS + 1, dtype=int)
        number[at] = N
        df = FardalStreamDF(gala_modified=False, random_state=np.random.default_rng(100 * k + len(law)))
        hamiltonian = gp.Hamiltonian(host)
        stream = df.sample(orbit, mass * u.Msun, hamiltonian=hamiltonian, n_particles=number)
        x = stream.xyz.to_value(u.kpc).T
        centre = orbit.xyz.to_value(u.kpc)[:, at]
        out = (x - centre) @ (centre / np.linalg.norm(centre))
        tails = {}
        for tail, side in [("leading", out < 0), ("trailing", out > 0)]:
            tails[tail] = [float(np.mean(out[side])), float(np.std(out[side]) / np.sqrt(side.sum()))]
        rows.append({"law": law, "since_over_age": time, "mass_msun": float(mass[at]), **tails})
        print(rows[-1], len(x))
with open("mass_loss.json", "w") as f:
    head = {"left": LEFT, "stream": s["name"], "columns": "mean distance outwards and its standard error, kpc"}
    lines = ",\n  ".join(json.dumps(row) for row in rows)
    f.write(json.dumps(head)[:-1] + ', "cases": [\n  ' + lines + "\n]}\n")
