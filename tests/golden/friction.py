#!/usr/bin/env python3
"""Make friction.json: dynamical friction on a progenitor.

    python friction.py        -> friction.json (a minute on one core)

"forces": Chandrasekhar's formula with a constant Coulomb logarithm, compared with galpy's ChandrasekharDynamicalFrictionForce, in the spherical NFW
halo and in the spherical logarithmic one. galpy takes the density from its own potential; the velocity dispersion is given to it: that
of Zentner & Bullock (2003) for NFW, v0 / sqrt(2) for the logarithmic halo.
"orbits": the orbit back from today in the sum of both forces, flattened halo and spherical friction, by scipy (DOP853, 1e-12), without
and with a mass that falls linearly in time.
Units: kpc, Gyr, Msun.
"""
import json
import math
import warnings

import numpy as np
from galpy.potential import ChandrasekharDynamicalFrictionForce, LogarithmicHaloPotential, NFWPotential
from scipy.integrate import solve_ivp
from scipy.special import erf

from haloes import G as G_MPF

warnings.filterwarnings("ignore")
G = float(G_MPF)


def dispersion(kind, mass, r_s, r):
    if kind == "logarithmic":
        return math.sqrt(G * mass / r_s / 2)
    x = r / r_s
    peak = 2.162581587064612
    v_max = math.sqrt(G * mass / r_s * (math.log1p(peak) - peak / (1 + peak)) / peak)
    return v_max * 1.4393 * x**0.354 / (1 + 1.1756 * x**0.725)


def density(kind, mass, r_s, r):
    if kind == "logarithmic":
        return mass / (4 * math.pi * r_s) * (r * r + 3 * r_s * r_s) / (r * r + r_s * r_s) ** 2
    return mass / (4 * math.pi * r * (r + r_s) ** 2)


def by_galpy(kind, mass, r_s, m, ln_lambda, x, v):
    """galpy works in natural units with G = 1: masses times G are in kpc^3/Gyr^2, lengths in kpc."""
    if kind == "logarithmic":
        halo = LogarithmicHaloPotential(amp=G * mass / r_s, core=r_s, q=1.0)
    else:
        halo = NFWPotential(amp=G * mass, a=r_s)
    force = ChandrasekharDynamicalFrictionForce(
        GMs=G * m, dens=halo, sigmar=lambda r: dispersion(kind, mass, r_s, r), const_lnLambda=ln_lambda, minr=1e-9)
    R, phi = math.hypot(x[0], x[1]), math.atan2(x[1], x[0])
    c, s = math.cos(phi), math.sin(phi)
    at = dict(R=R, z=x[2], phi=phi, v=[v[0] * c + v[1] * s, -v[0] * s + v[1] * c, v[2]])
    a_R = force.Rforce(**at)
    a_t = force.phitorque(**at) / R
    return [a_R * c - a_t * s, a_R * s + a_t * c, force.zforce(**at)]


def friction(kind, mass, r_s, m, ln_lambda, x, v):
    r, speed = np.linalg.norm(x), np.linalg.norm(v)
    X = speed / (math.sqrt(2) * dispersion(kind, mass, r_s, r))
    slower = erf(X) - 2 * X / math.sqrt(math.pi) * math.exp(-X * X)
    return -4 * math.pi * G * G * m * ln_lambda * density(kind, mass, r_s, r) * slower / speed**3 * v


def nfw(mass, r_s, q, n, x):
    along = n @ x
    m = math.sqrt(x @ x + (1 / q**2 - 1) * along * along)
    k = G * mass * (math.log1p(m / r_s) / m - 1 / (r_s + m)) / m**2
    return -k * (x + (1 / q**2 - 1) * along * n)


rng = np.random.default_rng(20261129)
forces = []
for k in range(24):
    kind = ["nfw", "logarithmic"][k % 2]
    mass, r_s = 10 ** rng.uniform(11.5, 13), 10 ** rng.uniform(0.7, 1.6)
    m, ln_lambda = 10 ** rng.uniform(7, 10), rng.uniform(1, 5)
    x = rng.standard_normal(3)
    x *= r_s * 10 ** rng.uniform(-1, 1) / np.linalg.norm(x)
    v = rng.standard_normal(3)
    # From far below the dispersion to above it.
    v *= dispersion(kind, mass, r_s, np.linalg.norm(x)) * 10 ** rng.uniform(-1.5, 0.5) / np.linalg.norm(v)
    a = by_galpy(kind, mass, r_s, m, ln_lambda, x, v)
    ours = friction(kind, mass, r_s, m, ln_lambda, x, v)
    apart = np.linalg.norm(ours - a) / np.linalg.norm(a)
    # galpy interpolates the dispersion.
    assert apart < 1e-6, (k, apart)
    forces.append(dict(kind=kind, mass_msun=mass, r_s_kpc=r_s, m_msun=m, coulomb_logarithm=ln_lambda,
                       x_kpc=list(x), v_kpc_per_gyr=list(v), acceleration=list(ours)))
orbits = []
n = np.array([0.36, 0.48, 0.8])
for left in [1.0, 0.2]:
    mass, r_s, q, m, ln_lambda, age = 10**12.1, 16.0, 0.7, 5e9, 3.0, 4.0
    kms = 1.0227121650537077
    today = [50.0, 0.0, 30.0] + [c * kms for c in (-40.0, 150.0, 20.0)]

    def slope(t, w):
        x, v = w[:3], w[3:]
        now = m * (1 - (1 - left) * (1 + t / age))
        return [*v, *(nfw(mass, r_s, q, n, x) + friction("nfw", mass, r_s, now, ln_lambda, x, v))]

    times = [-0.5, -1.0, -2.0, -3.0, -4.0]
    way = solve_ivp(slope, (0, -age), today, method="DOP853", rtol=1e-12, atol=1e-12, t_eval=times)
    orbits.append(dict(mass_msun=mass, r_s_kpc=r_s, q=q, axis=list(n), m_msun=m, coulomb_logarithm=ln_lambda, age_gyr=age,
                       left=left, today_x_kpc=today[:3], today_v_kpc_per_gyr=today[3:], times_gyr=times,
                       x_kpc=[list(x) for x in way.y[:3].T]))
with open("friction.json", "w") as f:
    rows = lambda cases: "[\n  " + ",\n  ".join(json.dumps(case) for case in cases) + "\n ]"
    f.write('{\n "G": ' + repr(G) + ',\n "forces": ' + rows(forces) + ',\n "orbits": ' + rows(orbits) + "\n}\n")
print("done")
