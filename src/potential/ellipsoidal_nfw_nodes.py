#!/usr/bin/env python3
"""Find the nodes of src/potential/ellipsoidal_nfw.rs: points and weights whose sum is nearest to the integral.

Least squares of the relative errors of force and potential over haloes and positions, weighted again a few times towards
the largest errors. The start is Gauss-Legendre in u with p = (101^u - 1) / 100; other starts end at the same nodes.

    pip install numpy scipy
    python3 ellipsoidal_nfw_nodes.py 8
"""

import itertools
import sys

import numpy as np
from scipy.optimize import least_squares

RADII = np.geomspace(0.003, 150.0, 28)  # in scale radii
ONE_AXIS = [0.5, 0.6, 0.75, 0.9, 1.0, 1.2, 1.5, 2.0]
TWO_AXES = [0.5, 0.75, 1.0, 1.5, 2.0], [0.5, 0.75, 1.4, 2.0]
COSINES = [0.0, 0.3, 0.6, 0.9, 1.0]  # to the axis of q


def family():
    """Rows of radius, q, p, and the cosines to the axes of q and of p."""
    rows = []
    for radius, cosine in itertools.product(RADII, COSINES):
        rows += [(radius, q, 1.0, cosine, 0.0) for q in ONE_AXIS]
        sine = np.sqrt(1.0 - cosine**2)
        for q, p in itertools.product(*TWO_AXES):
            rows += [(radius, q, p, cosine, c * sine) for c in (0.0, 1.0)]
    return np.array(rows).T


RADIUS, Q, P, TO_N, TO_B = family()
TO_THIRD = np.sqrt(np.maximum(0.0, 1.0 - TO_N**2 - TO_B**2))


def sums(points, weights):
    """Force along three axes, in G M / R_s^2, and minus the potential, in G M / R_s, of each row."""
    u2 = points**2
    q2, p2 = (Q**2)[:, None], (P**2)[:, None]
    least2 = np.minimum(np.minimum(q2, p2), 1.0)
    spread = least2 * (1.0 - u2) + u2
    of_q, of_p = ((a2 - least2) * u2 + least2 for a2 in (q2, p2))
    t = points / np.sqrt(spread)
    across_q, across_p = ((1.0 / a2 - 1.0) * a2 * u2 / of_a for a2, of_a in ((q2, of_q), (p2, of_p)))
    strength = weights * least2 * points / (spread * np.sqrt(of_q * of_p))
    r, n, b = RADIUS[:, None], (RADIUS * TO_N)[:, None], (RADIUS * TO_B)[:, None]
    mu = np.sqrt(r**2 + across_q * n**2 + across_p * b**2)
    k = strength / (mu * (1.0 + t * mu) ** 2)
    force = [(k * (1.0 + across_q)).sum(1) * n[:, 0], (k * (1.0 + across_p)).sum(1) * b[:, 0], k.sum(1) * RADIUS * TO_THIRD]
    return np.stack(force, 1), (strength / (t * (1.0 + t * mu))).sum(1)


def legendre(count, base):
    """Gauss-Legendre in u with p = ((base + 1)^u - 1) / base."""
    x, w = np.polynomial.legendre.leggauss(count)
    power = (base + 1.0) ** ((x + 1.0) / 2.0)
    return (power - 1.0) / base, 0.5 * w * np.log(base + 1.0) * power / base


FORCE, POTENTIAL = sums(*legendre(90, 2000.0))
LENGTH = np.linalg.norm(FORCE, axis=1)


def errors(points, weights):
    """Relative errors of each row: of the force, a vector, and of the potential."""
    force, potential = sums(points, weights)
    return np.column_stack([(force - FORCE) / LENGTH[:, None], potential / POTENTIAL - 1.0])


def unpacked(x):
    count = len(x) // 2
    return 1.0 / (1.0 + np.exp(-x[:count])), np.exp(x[count:])


def main():
    count = int(sys.argv[1])
    base = float(sys.argv[2]) if len(sys.argv) > 2 else 100.0
    points, weights = legendre(count, base)
    x = np.concatenate([np.log(points / (1.0 - points)), np.log(weights)])
    emphasis, best = np.ones(len(RADIUS)), None
    for _ in range(8):
        of = lambda x: (emphasis[:, None] * errors(*unpacked(x))).ravel()
        x = least_squares(of, x, method="lm", max_nfev=4000, ftol=1e-12, xtol=1e-12, gtol=1e-14).x
        found = errors(*unpacked(x))
        size = np.linalg.norm(found[:, :3], axis=1)
        if best is None or size.max() < best[0]:
            best = size.max(), x, size[P == 1.0].max(), np.abs(found[:, 3]).max(), np.sqrt((size**2).mean())
        emphasis *= np.sqrt(0.1 + size / size.max())
    print("force: max %.2e, with one axis %.2e, rms %.2e; potential: max %.2e" % (best[0], best[2], best[4], best[3]))
    for point, weight in sorted(zip(*unpacked(best[1]))):
        print(f"    ({point:.16e}, {weight:.16e}),")


if __name__ == "__main__":
    main()
