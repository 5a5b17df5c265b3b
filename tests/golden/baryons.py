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

import galpy.potential as galpy
import numpy as np
from outside import by_gala, by_galpy, gala_potential, galpy_potential, rotation

HERE = os.path.dirname(os.path.abspath(__file__))
KMS = 1.0227121650537077         # kpc/Gyr in 1 km/s
G = 4.30091e-6 * KMS**2
TOLERANCE = 1e-11
SEED = 20261128


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
    parameters = dict(kind="exponential", GM=mass * G, r_s=r_s, thickness=thickness)
    case = {
        "id": "disc_%d" % number, "kind": "exponential", "mass_msun": mass, "r_s_kpc": r_s,
        "thickness": thickness, "normal": list(normal),
    }
    values = by_gala(gala_potential(**parameters), in_disc)
    compare(case, values, by_galpy(galpy_potential(**parameters), in_disc))
    # The amplitude is a density: the mass is 4 pi h_R^2 h_z times it.
    amp = G * mass / (4 * np.pi * thickness * r_s**3)
    exact = galpy.DoubleExponentialDiskPotential(amp=amp, hr=r_s, hz=thickness * r_s)
    R, z = np.hypot(in_disc[0], in_disc[1]), in_disc[2]
    force = np.array([exact.Rforce(R, z, use_physical=False), exact.zforce(R, z, use_physical=False)])
    acc = np.array([*(force[0] * in_disc[:2] / R), force[1]])
    case["acc_exponential"] = list(matrix.T @ acc)
    return finished(case, x, matrix, values)


def bulge(rng, number):
    mass, r_s = 10 ** rng.uniform(8.5, 11), rng.uniform(0.2, 3)
    direction = rng.normal(size=3)
    x = direction / np.linalg.norm(direction) * 10 ** rng.uniform(-1, 2.2)
    parameters = dict(kind="hernquist", GM=mass * G, r_s=r_s)
    case = {"id": "bulge_%d" % number, "kind": "hernquist", "mass_msun": mass, "r_s_kpc": r_s}
    values = by_gala(gala_potential(**parameters), x)
    compare(case, values, by_galpy(galpy_potential(**parameters), x))
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


if __name__ == "__main__":
    main()
