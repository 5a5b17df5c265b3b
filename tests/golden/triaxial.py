#!/usr/bin/env python3
"""Make triaxial.json: the NFW halo whose density is constant on triaxial ellipsoids.

    python triaxial.py        -> triaxial.json (some minutes on one core)

The ellipsoids have the axis ratio q along the unit vector n, p along the unit vector b, and 1 along the third axis:
m^2 = |x|^2 + (1/q^2 - 1) (n.x)^2 + (1/p^2 - 1) (b.x)^2, rho = rho0 / (s (1 + s)^2), s = m / r_s,
rho0 = M / (4 pi p q r_s^3); phi is zero at infinity.

The values are mpmath's, from the integral over homoeoids (Binney & Tremaine 2008, eq. 2.140) with its derivatives under the
integral. They are compared with Poisson's equation, which knows the density alone; codes.py compares them with other codes.
Units: kpc, Msun, Gyr.
"""
import mpmath as mp
import numpy as np
from haloes import G, RULES, UNITS, differences, diff, dot, dump, n17, sig

mp.mp.dps = 40


class Case:
    def __init__(self, c):
        self.M, self.rs, self.q, self.p = (mp.mpf(c[k]) for k in ("mass_msun", "r_s_kpc", "q", "p"))
        n, b = ([mp.mpf(v) for v in c[k]] for k in ("axis", "second_axis"))
        n = [v / mp.sqrt(dot(n, n)) for v in n]
        b = [u - dot(n, b) * v for u, v in zip(b, n)]
        self.n, self.b = n, [v / mp.sqrt(dot(b, b)) for v in b]
        self.x = [mp.mpf(v) for v in c["x_kpc"]]

    def m2(self, x, q2, p2):
        return dot(x, x) + (1 / q2 - 1) * dot(self.n, x) ** 2 + (1 / p2 - 1) * dot(self.b, x) ** 2


def integral(c, x, with_slopes, rule=RULES[0]):
    """phi, and the acceleration and the Hessian if asked for. With t = (1 + tau)^(-1/2):
    phi = -(G M / r_s) int_0^1 dt / ((1 + s) (w_p w_q)^(1/2)), w_a = 1 - (1 - a^2) t^2, s = t mu / r_s,
    mu^2 = m^2 with p^2 and q^2 replaced by w_p and w_q."""
    ends = [mp.mpf(1)]
    while ends[-1] * mp.sqrt(dot(x, x)) / c.rs > 1 or ends[-1] > min(c.q, c.p) / 4:
        ends.append(ends[-1] / 2)
    ends.append(mp.mpf(0))
    total = [mp.mpf(0)] * (13 if with_slopes else 1)
    for hi, lo in zip(ends, ends[1:]):
        for node, weight in rule:
            t = (hi + lo) / 2 + (hi - lo) / 2 * node
            wq, wp = 1 - (1 - c.q ** 2) * t ** 2, 1 - (1 - c.p ** 2) * t ** 2
            f = weight * (hi - lo) / 2 / mp.sqrt(wp * wq)
            mu = mp.sqrt(c.m2(x, wq, wp))
            s = t * mu / c.rs
            total[0] += f / (1 + s)
            if not with_slopes:
                continue
            # d/dmu of 1 / (1 + s), and of that over mu
            d1 = -(t / c.rs) / (1 + s) ** 2 / mu
            d2 = (t / c.rs) * (1 + 3 * s) / (1 + s) ** 3 / mu ** 3
            M = [[(i == j) + (1 / wq - 1) * c.n[i] * c.n[j] + (1 / wp - 1) * c.b[i] * c.b[j] for j in range(3)]
                 for i in range(3)]
            y = [dot(row, x) for row in M]
            for i in range(3):
                total[1 + i] += f * d1 * y[i]
                for j in range(3):
                    total[4 + 3 * i + j] += f * (d1 * M[i][j] + d2 * y[i] * y[j])
    scale = -mp.mpf(G) * c.M / c.rs
    return [scale * v for v in total]


def main():
    rng = np.random.RandomState(20261129)
    ratios = np.geomspace(0.003, 150, 24)
    cases, worst = [], {}
    for k in range(24):
        rs, r = sig(rng.uniform(5, 25)), None
        r = ratios[k] * rs
        q, p = sig(2 ** rng.uniform(-1, 1)), sig(2 ** rng.uniform(-1, 1))
        if k == 5:
            q = p = 1.0
        if k == 11:
            p = q
        n, b, u = (rng.normal(size=3) for _ in range(3))
        n /= np.linalg.norm(n)
        b -= n * (n @ b)
        b /= np.linalg.norm(b)
        c = {"mass_msun": sig(10 ** rng.uniform(11.5, 12.5), 8), "r_s_kpc": rs, "q": q, "p": p,
             "axis": [float(v) for v in n], "second_axis": [float(v) for v in b],
             "x_kpc": [sig(v, 9) for v in r * u / np.linalg.norm(u)]}
        case = Case(c)
        v = integral(case, case.x, True)
        twice = integral(case, case.x, True, RULES[1])
        phi, acc, hess = v[0], [-a for a in v[1:4]], [v[4 + 3 * i:7 + 3 * i] for i in range(3)]
        s = mp.sqrt(case.m2(case.x, case.q ** 2, case.p ** 2)) / case.rs
        rho = case.M / (4 * mp.pi * case.p * case.q * case.rs ** 3) / (s * (1 + s) ** 2)
        trace = hess[0][0] + hess[1][1] + hess[2][2]
        by_differences, _ = differences(lambda x: integral(case, x, False)[0], case.x, mp.sqrt(dot(case.x, case.x)) * mp.mpf("1e-10"))
        for key, a, e in [("doubling", v, twice), ("poisson", trace / (4 * mp.pi * mp.mpf(G)), rho),
                          ("differences", by_differences, acc)]:
            worst[key] = max(worst.get(key, mp.mpf(0)), diff(a, e))
        cases.append({"id": k, **c, "axis": n17(c["axis"]), "second_axis": n17(c["second_axis"]),
                      "phi": n17(phi), "acc": n17(acc), "density": n17(rho), "hess": n17(hess)})
        print(k, {key: mp.nstr(v, 3) for key, v in worst.items()}, flush=True)
    assert worst["doubling"] < 1e-25 and worst["poisson"] < 1e-25 and worst["differences"] < 1e-16
    dump("triaxial.json", {
        "what": "potential, acceleration, density and Hessian of the triaxial NFW halo",
        "units": UNITS,
        "value_units": {"phi": "(kpc/Gyr)^2", "acc": "kpc/Gyr^2", "density": "Msun/kpc^3", "hess": "1/Gyr^2"},
        "sign": "acc = -grad(phi); hess = +d2 phi/dxi dxj, 3x3; density = trace(hess)/(4 pi G)",
        "worst_relative_differences": {key: mp.nstr(v, 3) for key, v in worst.items()},
        "cases": cases})


if __name__ == "__main__":
    main()
