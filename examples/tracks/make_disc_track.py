"""Makes disc_edge_on.csv, the track of the worked example in docs/disc.md: python3 examples/tracks/make_disc_track.py

A stream of 60,000 particles by gala around a galaxy with a disc that is seen edge-on, in an NFW halo that is flattened in its potential
along an axis 20 degrees from the normal of the disc. The track has the bins with at least 1 % of the particles and Gaussian noise of 5 % of
the radius; five of its bins have mean line-of-sight velocities with Gaussian noise of 10 km/s. Needs gala and astropy; a minute or two.
"""
import math
import pathlib
import random

import astropy.units as u
import gala.dynamics as gd
import gala.potential as gp
import numpy as np
from gala.units import galactic

HERE = pathlib.Path(__file__).parent
KMS = 1.0227121650537077
HALO = {"log10_m_halo": 12.0, "r_s_halo_kpc": 16.0, "q": 0.8}
DISC = {"log10_m_disc": 10.7, "r_disc_kpc": 4.0, "thickness": 0.1, "inclination_disc_deg": 90.0, "phi_disc_deg": 30.0}
PROGENITOR = {"log10_m_prog": 8.0, "r_s_prog_kpc": 1.0}
X_KPC, V_KM_S, AGE_GYR = (42.0, 0.0, 16.0), (-35.0, 140.0, 50.0), 1.5
STEPS, PER_STEP = 600, 50
PHI_OF_VELOCITIES = [-45, -25, -5, 25, 45]
R_ERROR, V_ERROR_KM_S = 0.05, 10


def rotation_to(axis):
    """A rotation whose third row is the axis."""
    axis = np.array(axis) / np.linalg.norm(axis)
    other = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    other /= np.linalg.norm(other)
    return np.array([other, np.cross(axis, other), axis])


angle = math.radians(DISC["phi_disc_deg"])
normal = np.array([-math.sin(angle), math.cos(angle), 0.0])
tilt = math.radians(20.0)
axis = normal * math.cos(tilt) + np.array([0.0, 0.0, 1.0]) * math.sin(tilt)
halo = gp.NFWPotential(m=10 ** HALO["log10_m_halo"] * u.Msun, r_s=HALO["r_s_halo_kpc"] * u.kpc, c=HALO["q"],
                       R=rotation_to(axis), units=galactic)
disc = gp.MiyamotoNagaiPotential(m=10 ** DISC["log10_m_disc"] * u.Msun, a=DISC["r_disc_kpc"] * u.kpc,
                                 b=DISC["thickness"] * DISC["r_disc_kpc"] * u.kpc, R=rotation_to(normal), units=galactic)
host = gp.CCompositePotential(halo=halo, disc=disc)
mass = 10 ** PROGENITOR["log10_m_prog"] * u.Msun
sat = gp.PlummerPotential(m=mass, b=PROGENITOR["r_s_prog_kpc"] * u.kpc, units=galactic)
today = gd.PhaseSpacePosition(pos=list(X_KPC) * u.kpc, vel=[v * KMS for v in V_KM_S] * u.kpc / u.Gyr)
df = gd.FardalStreamDF(gala_modified=True, random_state=np.random.RandomState(20261129))
generator = gd.MockStreamGenerator(df, gp.Hamiltonian(host), progenitor_potential=sat)
stream, _ = generator.run(today, mass, n_particles=PER_STEP, dt=-AGE_GYR / STEPS * u.Gyr, n_steps=STEPS)
x = stream.xyz.to_value(u.kpc).T
v = stream.v_xyz.to_value(u.kpc / u.Gyr).T / KMS
# Both tails are shorter than half a turn.
phi = np.degrees(np.arctan2(x[:, 1], x[:, 0]))
r = np.hypot(x[:, 0], x[:, 1])
number = np.floor(phi / 10).astype(int)
noise = random.Random(20261129)
rows = []
for b in range(-18, 18):
    inside = number == b
    if inside.sum() < 0.01 * len(x):
        continue
    centre = 10 * b + 5
    measured = r[inside].mean() * (1 + R_ERROR * noise.gauss(0, 1))
    velocity = ","
    if centre in PHI_OF_VELOCITIES:
        velocity = f"{-v[inside, 2].mean() + V_ERROR_KM_S * noise.gauss(0, 1):.1f},{V_ERROR_KM_S}"
    rows.append(f"{centre},{measured:.2f},{R_ERROR * measured:.2f},{velocity}")
    print(rows[-1], int(inside.sum()), round(r[inside].std(), 2))
head = ["# name: disc_edge_on", "# bin_width: 10", "phi,r,r_err,v,v_err"]
(HERE / "disc_edge_on.csv").write_text("\n".join(head + rows) + "\n")
