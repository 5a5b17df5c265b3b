#!/usr/bin/env python3
"""Make baryons.json: exponential discs by three Miyamoto-Nagai discs, and Hernquist bulges.

    python baryons.py

The numbers are gala's; galpy must agree with each to TOLERANCE of the largest of its vector or matrix. For
every disc the file also has the acceleration of the double exponential disc that the three approximate
(galpy's DoubleExponentialDiskPotential, by quadrature).
Needs gala, galpy, numpy. Units: kpc, Msun, Gyr.
"""
import json
import os
import warnings

import astropy.units as u
import gala.potential as gp
import galpy.potential as galpy
import numpy as np
from gala.units import UnitSystem

HERE = os.path.dirname(os.path.abspath(__file__))
KMS = 1.0227121650537077         # kpc/Gyr in 1 km/s
G = 4.30091e-6 * KMS**2
UNITS = UnitSystem(u.kpc, u.Gyr, u.Msun, u.radian)
TOLERANCE = 1e-11
SEED = 20261128


# Its quadrature divides infinities at the ends.
warnings.filterwarnings("ignore", module="galpy")


def rotation(normal):
    """The matrix whose rows are the axes of a disc with this normal."""
    helper = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.5 else np.array([0.0, 1.0, 0.0])
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first), normal])


def by_gala(potential, x):
    x = x[:, None]
    return (
        potential.energy(x).value[0],
        -potential.gradient(x).value[:, 0],
        potential.hessian(x).value[:, :, 0],
    )


def by_galpy(potential, x):
    R, z, phi = np.hypot(x[0], x[1]), x[2], np.arctan2(x[1], x[0])
    on = dict(use_physical=False)
    F_R, F_z = potential.Rforce(R, z, **on), potential.zforce(R, z, **on)
    RR, zz, Rz = potential.R2deriv(R, z, **on), potential.z2deriv(R, z, **on), potential.Rzderiv(R, z, **on)
    c, s = np.cos(phi), np.sin(phi)
    to_xyz = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    cylindrical = np.array([[RR, 0, Rz], [0, -F_R / R, 0], [Rz, 0, zz]])
    acc = np.array([F_R * c, F_R * s, F_z])
    return potential(R, z, **on), acc, to_xyz @ cylindrical @ to_xyz.T


def compare(case, mine, other):
    for a, b in zip(mine, other):
        worst = np.max(np.abs(np.asarray(a) - b)) / np.max(np.abs(b))
        assert worst < TOLERANCE, (case["id"], worst)


def finished(case, x, matrix, values):
    phi, acc, hess = values
    case["x_kpc"] = list(x)
    case["phi"] = float(phi)
    case["acc"] = list(matrix.T @ acc)
    case["hess"] = (matrix.T @ hess @ matrix).tolist()
    case["density"] = float(np.trace(hess) / (4 * np.pi * G))
    return case


def disc(rng, number):
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    mass, r_s = 10 ** rng.uniform(9.5, 11.2), rng.uniform(1.5, 6)
    thickness = rng.uniform(0.05, 0.4)
    direction = rng.normal(size=3)
    x = direction / np.linalg.norm(direction) * 10 ** rng.uniform(0.3, 2.2)
    matrix = rotation(normal)
    in_disc = matrix @ x
    gala = gp.MN3ExponentialDiskPotential(
        m=mass * G / gp.MN3ExponentialDiskPotential(m=1, h_R=1, h_z=0.1, units=UNITS).G,
        h_R=r_s, h_z=thickness * r_s, positive_density=True, sech2_z=False, units=UNITS,
    )
    # galpy's amplitude is a density: the mass is 4 pi h_R^2 h_z times it.
    lengths = dict(hr=r_s, hz=thickness * r_s)
    amp = G * mass / (4 * np.pi * thickness * r_s**3)
    three = galpy.MN3ExponentialDiskPotential(amp=amp, posdens=True, **lengths)
    case = {
        "id": "disc_%d" % number, "kind": "exponential", "mass_msun": mass, "r_s_kpc": r_s,
        "thickness": thickness, "normal": list(normal),
    }
    values = by_gala(gala, in_disc)
    compare(case, values, by_galpy(three, in_disc))
    exact = galpy.DoubleExponentialDiskPotential(amp=amp, **lengths)
    R, z = np.hypot(in_disc[0], in_disc[1]), in_disc[2]
    force = np.array([exact.Rforce(R, z, use_physical=False), exact.zforce(R, z, use_physical=False)])
    acc = np.array([*(force[0] * in_disc[:2] / R), force[1]])
    case["acc_exponential"] = list(matrix.T @ acc)
    return finished(case, x, matrix, values)


def bulge(rng, number):
    mass, r_s = 10 ** rng.uniform(8.5, 11), rng.uniform(0.2, 3)
    direction = rng.normal(size=3)
    x = direction / np.linalg.norm(direction) * 10 ** rng.uniform(-1, 2.2)
    unit = gp.HernquistPotential(m=1, c=1, units=UNITS)
    gala = gp.HernquistPotential(m=mass * G / unit.G, c=r_s, units=UNITS)
    case = {"id": "bulge_%d" % number, "kind": "hernquist", "mass_msun": mass, "r_s_kpc": r_s}
    values = by_gala(gala, x)
    # galpy's amplitude is twice the mass.
    compare(case, values, by_galpy(galpy.HernquistPotential(amp=2 * G * mass, a=r_s), x))
    return finished(case, x, np.eye(3), values)


def main():
    rng = np.random.default_rng(SEED)
    cases = [disc(rng, i) for i in range(24)] + [bulge(rng, i) for i in range(16)]
    path = os.path.join(HERE, "baryons.json")
    with open(path, "w") as f:
        f.write('{\n "cases": [\n')
        f.write(",\n".join("  " + json.dumps(case) for case in cases))
        f.write("\n ]\n}\n")
    print("wrote", path)


main()
