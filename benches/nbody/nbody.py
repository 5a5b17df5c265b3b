#!/usr/bin/env python3
"""Three N-body streams: a Plummer sphere of 20,000 particles falls apart in a halo that is flattened in its potential.

    python nbody.py [k]       -> n0_*.ecsv ...; only stream number k (some minutes each on one core)

Settings and truth are in nbody.toml. The gravity of the particles is the tree of pytreegrav (public, MIT); the halo is fixed. Leapfrog,
kick-drift-kick. The sphere starts, isotropic, where a test particle was at -T that is today in the state there. All stars that are not bound to the remnant make the track: mean projected radius in bins of 10 degrees of the angle that a star has gone round the centre more than the remnant,
every bin with at least 1 % of the particles, with Gaussian noise of 2 %. The same table has mean line-of-sight velocities -vz with a noise of 5 km/s.
r_err and v_err have the noise and the standard error of the mean. Units: kpc, Msun, Gyr; velocities of the table in km/s.
"""
import pathlib
import sys
import tomllib

import numpy as np
from pytreegrav import Accel, Potential

KMS = 1.0227121650537077         # kpc/Gyr in 1 km/s
G = 4.30091e-6 * KMS**2          # kpc^3 / (Msun Gyr^2)

with open(pathlib.Path(__file__).with_name("nbody.toml"), "rb") as f:
    CARD = tomllib.load(f)
N, SOFTENING, DT = CARD["particles"], CARD["softening_kpc"], CARD["step_gyr"]
STREAMS = [
    dict(name=s["name"], M=10 ** s["log10_m_halo"], Rs=s["r_s_halo_kpc"], q=s["q"], n=s["axis"], m=s["m_dwarf"], a=s["plummer_radius_kpc"],
         x=s["x_kpc"], v=s["v_km_s"], T=s["age_gyr"], seed=s["seed"])
    for s in CARD["streams"]
]


def halo(s, x):
    n = np.array(s["n"]) / np.linalg.norm(s["n"])
    e = 1 / s["q"] ** 2 - 1
    along = x @ n
    y = x + e * along[:, None] * n
    m = np.sqrt(np.einsum("ij,ij->i", x, x) + e * along**2)
    k = G * s["M"] * (np.log1p(m / s["Rs"]) / m - 1 / (s["Rs"] + m)) / m**2
    return -k[:, None] * y


def start(s):
    """the state of a test particle at -T"""
    x, v = np.array([s["x"]]), -np.array([s["v"]]) * KMS
    for _ in range(int(round(s["T"] / DT))):
        v += 0.5 * DT * halo(s, x)
        x += DT * v
        v += 0.5 * DT * halo(s, x)
    return x[0], -v[0]


def plummer(s, rng):
    """positions and isotropic velocities (Aarseth, Henon and Wielen 1974), out to ten radii"""
    largest = (1 + 1 / 100) ** -1.5
    r = s["a"] / np.sqrt((largest * rng.random(N)) ** (-2 / 3) - 1)
    q = np.empty(0)
    while len(q) < N:
        x, y = rng.random(N), 0.1 * rng.random(N)
        q = np.append(q, x[y < x**2 * (1 - x**2) ** 3.5])
    speed = q[:N] * np.sqrt(2 * G * s["m"]) * (r**2 + s["a"] ** 2) ** -0.25

    def isotropic():
        u = rng.normal(size=(N, 3))
        return u / np.linalg.norm(u, axis=1)[:, None]

    x, v = r[:, None] * isotropic(), speed[:, None] * isotropic()
    return x - x.mean(0), v - v.mean(0)


def bound(s, mass, x, v, inside):
    """the particles with a negative energy in the frame of those that are bound, found again until they are the same"""
    for _ in range(20):
        phi = np.zeros(N)
        phi[inside] = Potential(x[inside], mass[inside], np.full(inside.sum(), SOFTENING), G=G)
        far = ~inside
        if far.any():
            centre = x[inside].mean(0)
            phi[far] = -G * mass[inside].sum() / np.linalg.norm(x[far] - centre, axis=1)
        energy = 0.5 * np.sum((v - v[inside].mean(0)) ** 2, axis=1) + phi
        near = np.linalg.norm(x - np.median(x[inside], axis=0), axis=1) < 10 * s["a"]
        now = (energy < 0) & near
        if (now == inside).all() or now.sum() < 20:
            break
        inside = now
    return inside


def make(s):
    rng = np.random.default_rng(s["seed"])
    x0, v0 = start(s)
    x, v = plummer(s, rng)
    x, v = x + x0, v + v0
    mass, soft = np.full(N, s["m"] / N), np.full(N, SOFTENING)
    angle = np.arctan2(x[:, 1], x[:, 0])
    # Beside that of the middle of the sphere: its stars may lie on both sides of 180 degrees.
    middle = np.arctan2(x0[1], x0[0])
    gone = middle + (angle - middle + np.pi) % (2 * np.pi) - np.pi

    def force(x):
        return Accel(x, mass, soft, G=G, theta=0.7) + halo(s, x)

    a = force(x)
    steps = int(round(s["T"] / DT))
    inside = np.ones(N, bool)
    for k in range(steps):
        v += 0.5 * DT * a
        x = x + DT * v
        a = force(x)
        v += 0.5 * DT * a
        now = np.arctan2(x[:, 1], x[:, 0])
        gone += (now - angle + np.pi) % (2 * np.pi) - np.pi
        angle = now
        if k % 100 == 99:
            inside = bound(s, mass, x, v, inside)
            print(s["name"], k + 1, "bound fraction %.3f" % inside.mean(), flush=True)
    phi = np.degrees(gone - np.median(gone[inside]))
    r = np.hypot(x[:, 0], x[:, 1])
    stream = ~inside
    number = np.floor(phi / 10).astype(int)
    rows = []
    for b in range(number.min(), number.max() + 1):
        here = stream & (number == b)
        n = here.sum()
        if n >= 0.01 * N:
            mean, of_mean = r[here].mean(), r[here].std() / np.sqrt(n)
            los = -v[here][:, 2] / KMS
            rows.append((b * 10 + 5, mean * (1 + 0.02 * rng.normal()), np.hypot(0.02 * mean, of_mean), n,
                         los.mean() + 5 * rng.normal(), np.hypot(5, los.std() / np.sqrt(n))))
    centre = x[inside].mean(0)
    # The table's x axis goes through the remnant.
    turn = np.arctan2(centre[1], centre[0])
    n = np.array(s["n"]) / np.linalg.norm(s["n"])
    c, t = np.cos(turn), np.sin(turn)
    axis = [c * n[0] + t * n[1], -t * n[0] + c * n[1], n[2]]
    with open(s["name"] + ".ecsv", "w") as f:
        f.write("# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n")
        for name, unit in [("phi", "deg"), ("r", "kpc"), ("r_err", "kpc"), ("n", ""), ("v", "km / s"), ("v_err", "km / s")]:
            f.write("# - {name: %s, %sdatatype: float64}\n" % (name, "unit: %s, " % unit if unit else ""))
        f.write("# meta:\n#   name: %s\n#   bin_width: 10.0\n#   q_true: %s\n#   bound_fraction: %.4f\n" % (s["name"], s["q"], inside.mean()))
        f.write("#   remnant_kpc: [%.3f, 0.0, %.3f]\n#   axis: [%.4f, %.4f, %.4f]\n" % (np.hypot(centre[0], centre[1]), centre[2], *axis))
        f.write("# schema: astropy-2.0\nphi,r,r_err,n,v,v_err\n")
        for row in rows:
            f.write("%d,%.5f,%.5f,%d,%.4f,%.4f\n" % row)
    print(s["name"], len(rows), "bins", flush=True)


for k, s in enumerate(STREAMS):
    if len(sys.argv) < 2 or int(sys.argv[1]) == k:
        make(s)
