#!/usr/bin/env python3
"""Make haloes.json: two flattened haloes, the density-flattened NFW and the logarithmic potential.

    python haloes.py          -> haloes.json (half a minute on one core)

Both are centred on the origin and symmetric about the unit vector n; m^2 = R^2 + z^2/q^2 with z = n.x
and R^2 = |x|^2 - z^2.

nfw_density: rho = rho0 / (s (1 + s)^2), s = m / r_s, rho0 = M / (4 pi q r_s^3); phi is zero at infinity.
logarithmic: phi = v0^2 ln(m^2 + r_s^2) / 2 with m in kpc, v0^2 = G M / r_s. Its density is negative near
the axis where q < 1/sqrt(2), far out.

The values are mpmath's. The Hessian of nfw_density is compared with Poisson's equation and with differences of phi;
codes.py compares all with other codes. Needs mpmath, numpy.
Units: kpc, Msun, Gyr.
"""
import json
import os
import sys

import mpmath as mp
import numpy as np
from mpmath.calculus.quadrature import GaussLegendre

HERE = os.path.dirname(os.path.abspath(__file__))
DPS = 60
mp.mp.dps = DPS

# G as in generate.py: the double nearest to the decimal product, then taken as exact
G_KMS = "4.30091e-6"             # kpc (km/s)^2 / Msun
KMS = "1.0227121650537077"       # kpc/Gyr in 1 km/s
G = float(mp.mpf(G_KMS) * mp.mpf(KMS) ** 2)
UNITS = {
    "length": "kpc", "mass": "Msun", "time": "Gyr", "velocity": "kpc/Gyr",
    "G_kpc_kms2_per_Msun": G_KMS, "kpc_per_Gyr_in_1_kms": KMS,
    "G_kpc3_per_Msun_Gyr2": G,
    "G_exact_decimal_product": mp.nstr(mp.mpf(G_KMS) * mp.mpf(KMS) ** 2, 30),
}
QS = [0.5, 0.6, 0.8, 0.95, 1.0, 1.05, 1.2, 1.5, 2.0]
TOL_EXACT = mp.mpf("1e-25")      # largest relative difference allowed between the ways of mpmath
IJ = [(i, j) for i in range(3) for j in range(3)]


def n17(v):
    if isinstance(v, (list, tuple, np.ndarray)):
        return [n17(e) for e in v]
    return "@@%s@@" % mp.nstr(mp.mpf(v), 17, min_fixed=1, max_fixed=0, strip_zeros=False)


def dump(name, obj):
    """one top-level key per line, one case per line; n17 marks become bare numbers"""
    out = ["{"]
    keys = list(obj)
    for i, k in enumerate(keys):
        end = "," if i + 1 < len(keys) else ""
        v = obj[k]
        if isinstance(v, list) and v and isinstance(v[0], dict):
            out.append(" %s: [" % json.dumps(k))
            out += ["  " + json.dumps(c) + ("," if j + 1 < len(v) else "") for j, c in enumerate(v)]
            out.append(" ]" + end)
        else:
            out.append(" %s: %s%s" % (json.dumps(k), json.dumps(v), end))
    out.append("}")
    txt = "\n".join(out).replace('"@@', "").replace('@@"', "") + "\n"
    json.loads(txt)
    with open(os.path.join(HERE, name), "w") as f:
        f.write(txt)
    print("wrote", name, len(txt), "bytes")


def sig(v, d=6):
    return float("%.*g" % (d, v))


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def norm(v):
    """of a number, a vector or a matrix"""
    return mp.sqrt(sum(mp.mpf(c) ** 2 for c in np.ravel(np.array(v, dtype=object))))


def diff(a, b):
    """norm of the difference over the norm of b"""
    a, b = (np.array(v, dtype=object) for v in (a, b))
    return norm(a - b) / norm(b)


# ------------------------------------------------------------------- mpmath

class Case:
    """the parameters as mpf, taken as exact; only the axis is brought to unit length"""

    def __init__(self, c):
        self.M, self.rs, self.q = mp.mpf(c["mass_msun"]), mp.mpf(c["r_s_kpc"]), mp.mpf(c["q"])
        a = [mp.mpf(v) for v in c["axis"]]
        self.n = [v / mp.sqrt(dot(a, a)) for v in a]
        self.x = [mp.mpf(v) for v in c["x_kpc"]]
        self.GM = mp.mpf(G) * self.M

    def m2(self, x):
        z = dot(self.n, x)
        return dot(x, x) - z ** 2 + (z / self.q) ** 2


RULES = [[(mp.mpf(t), mp.mpf(w)) for t, w in GaussLegendre(mp.mp).calc_nodes(d, int(DPS * 3.33) + 20)]
         for d in (6, 7)]


def nfw_integral(c, x, integrand, rule):
    """Binney & Tremaine (2008) eq. 2.140, Merritt & Fridman (1996): with a1 = a2 = 1, a3 = q and
    q / sqrt(q^2 + tau) = w,  phi = -(G M q / r_s) int_0^1 dw / (D (1 + s)),  D = q^2 + (1 - q^2) w^2,
    s = w sqrt(R^2 / D + z^2 / q^2) / r_s. Gauss-Legendre on pieces that double from where s = 1."""
    z = dot(c.n, x)
    R2 = dot(x, x) - z ** 2
    ends = [mp.mpf(1)]
    while ends[-1] * mp.sqrt(dot(x, x)) / c.rs > 1:
        ends.append(ends[-1] / 2)
    ends.append(mp.mpf(0))
    total = None
    for b, a in zip(ends, ends[1:]):
        for t, weight in rule:
            w = (a + b) / 2 + (b - a) / 2 * t
            D = c.q ** 2 + (1 - c.q ** 2) * w ** 2
            s = w * mp.sqrt(R2 / D + (z / c.q) ** 2) / c.rs
            f = integrand(w, D, s, z)
            f = [weight * (b - a) / 2 * v for v in f]
            total = f if total is None else [u + v for u, v in zip(total, f)]
    return [-c.GM * c.q / c.rs * v for v in total]


def nfw_phi(c, x, rule=RULES[0]):
    return nfw_integral(c, x, lambda w, D, s, z: [1 / (D * (1 + s))], rule)[0]


def nfw_all(c, rule):
    """phi, acc, hess under the integral: 1 / (1 + s) as a function of u = s^2, and u is quadratic in x"""
    n, x = c.n, c.x

    def integrand(w, D, s, z):
        h1 = -1 / (2 * s * (1 + s) ** 2)
        h2 = (1 + 3 * s) / (4 * s ** 3 * (1 + s) ** 3)
        k = 2 * w ** 2 / c.rs ** 2
        e = 1 / c.q ** 2 - 1 / D                      # u = (k / 2) (|x|^2 / D + e z^2)
        du = [k * (x[i] / D + e * z * n[i]) for i in range(3)]
        return ([1 / (D * (1 + s))] + [h1 * v / D for v in du]
                + [(h2 * du[i] * du[j] + h1 * k * ((i == j) / D + e * n[i] * n[j])) / D for i, j in IJ])

    v = nfw_integral(c, x, integrand, rule)
    return v[0], [-a for a in v[1:4]], [v[4 + 3 * i:7 + 3 * i] for i in range(3)]


def nfw_density(c):
    s = mp.sqrt(c.m2(c.x)) / c.rs
    return c.M / (4 * mp.pi * c.q * c.rs ** 3) / (s * (1 + s) ** 2)


def differences(f, x, h):
    """acc and hess of f by central differences"""
    def at(*moves):
        y = list(x)
        for i, k in moves:
            y[i] += k * h
        return f(y)

    f0 = f(x)
    up, down = [at((i, 1)) for i in range(3)], [at((i, -1)) for i in range(3)]
    acc = [-(up[i] - down[i]) / (2 * h) for i in range(3)]
    H = [[None] * 3 for _ in range(3)]
    for i in range(3):
        H[i][i] = (up[i] - 2 * f0 + down[i]) / h ** 2
        for j in range(i):
            H[i][j] = H[j][i] = (at((i, 1), (j, 1)) - at((i, 1), (j, -1)) - at((i, -1), (j, 1))
                                 + at((i, -1), (j, -1))) / (4 * h ** 2)
    return acc, H


def exact_nfw(c, worst):
    v, twice = nfw_all(c, RULES[0]), nfw_all(c, RULES[1])
    rho = nfw_density(c)
    note(worst, "doubling", max(diff(a, b) for a, b in zip(v, twice)))
    note(worst, "poisson", diff((v[2][0][0] + v[2][1][1] + v[2][2][2]) / (4 * mp.pi * mp.mpf(G)), rho))
    acc, hess = differences(lambda x: nfw_phi(c, x), c.x, mp.sqrt(dot(c.x, c.x)) * mp.mpf("1e-14"))
    note(worst, "differences_acc", diff(acc, v[1]))
    note(worst, "differences_hess", diff(hess, v[2]))
    if c.q == 1:
        r = mp.sqrt(dot(c.x, c.x))
        note(worst, "closed_form_q1", diff(v[0], -c.GM / r * mp.log1p(r / c.rs)))
    return v[0], v[1], v[2], rho


def exact_log(c, worst):
    """phi alone is coded; mpmath differentiates it"""
    def phi(*x):
        return c.GM / c.rs * mp.log(c.m2(x) + c.rs ** 2) / 2

    def partial(*axes):
        return mp.diff(phi, tuple(c.x), tuple(axes.count(k) for k in range(3)))

    acc = [-partial(i) for i in range(3)]
    hess = [[partial(i, j) for j in range(3)] for i in range(3)]
    # closed form as a check: phi = F(u), u = |x|^2 + e z^2
    e, z, u = 1 / c.q ** 2 - 1, dot(c.n, c.x), c.m2(c.x) + c.rs ** 2
    g = [c.x[i] + e * z * c.n[i] for i in range(3)]
    k = c.GM / c.rs / u
    note(worst, "closed_form_acc", diff(acc, [-k * v for v in g]))
    note(worst, "closed_form_hess", diff(hess, [[k * ((i == j) + e * c.n[i] * c.n[j] - 2 * g[i] * g[j] / u)
                                                 for j in range(3)] for i in range(3)]))
    rho = (hess[0][0] + hess[1][1] + hess[2][2]) / (4 * mp.pi * mp.mpf(G))
    return phi(*c.x), acc, hess, rho


# -------------------------------------------------------------------- cases

def note(worst, key, value):
    worst[key] = max(worst.get(key, mp.mpf(0)), mp.mpf(value))


def parameters(rng):
    """24 generic cases with |x| / r_s from 0.003 to 150, two on the axis and two in the plane"""
    out = []
    ratios = np.geomspace(0.003, 150, 24)
    for k in range(28):
        tag = "generic" if k < 24 else "on_axis" if k < 26 else "in_plane"
        rs = sig(rng.uniform(5, 25))
        n = rng.normal(size=3)
        u = rng.normal(size=3)
        q, r = (QS[4 * k % 9], ratios[k] * rs) if k < 24 else ([0.6, 1.5][k % 2], [4.0, 0.5][k % 2] * rs)
        n, x = n / np.linalg.norm(n), [sig(v, 9) for v in r * u / np.linalg.norm(u)]
        if tag == "on_axis":
            n, x = [0.0, 0.0, 1.0], [0.0, 0.0, sig(r if k % 2 else -r)]
        if tag == "in_plane":
            n, x[0] = [1.0, 0.0, 0.0], 0.0
        out.append({"tag": tag, "mass_msun": sig(10 ** rng.uniform(11.5, 12.5), 8), "r_s_kpc": rs, "q": q,
                    "axis": [float(v) for v in n], "x_kpc": x})
    return out


def main():
    rng = np.random.RandomState(20240632)
    cases, internal = [], {}
    for kind, exact in (("nfw_density", exact_nfw), ("logarithmic", exact_log)):
        own, negative = {}, 0
        for par in parameters(rng):
            phi, acc, hess, rho = exact(Case(par), own)
            negative += rho < 0
            scale = norm(hess) * mp.mpf(10) ** -35     # zero by symmetry comes out as 1e-50 or so: write 0
            hess = [[mp.mpf(0) if abs(v) < scale else v for v in row] for row in hess]
            acc = [mp.mpf(0) if abs(v) < norm(acc) * mp.mpf(10) ** -35 else v for v in acc]
            case = {"id": len(cases), "kind": kind}
            case.update(par)
            case["axis"] = n17(par["axis"])
            case.update({"phi": n17(phi), "acc": n17(acc), "density": n17(rho), "hess": n17(hess)})
            cases.append(case)
        print(kind, "mpmath's ways:", {k: mp.nstr(v, 3) for k, v in own.items()}, "negative densities:", negative, flush=True)
        assert max(own.values()) < TOL_EXACT, kind
        internal[kind] = {k: mp.nstr(v, 3) for k, v in own.items()}
    dump("haloes.json", {
        "what": "potential, acceleration, density and Hessian of the density-flattened NFW halo and of the "
                "logarithmic halo",
        "units": UNITS,
        "value_units": {"phi": "(kpc/Gyr)^2", "acc": "kpc/Gyr^2", "density": "Msun/kpc^3", "hess": "1/Gyr^2"},
        "sign": "acc = -grad(phi); hess = +d2 phi/dxi dxj, 3x3; density = trace(hess)/(4 pi G)",
        "kinds": {
            "nfw_density": "rho = rho0 / (s (1+s)^2), s = m/r_s, rho0 = M / (4 pi q r_s^3), phi = 0 at infinity",
            "logarithmic": "phi = v0^2 ln(m^2 + r_s^2) / 2, m and r_s in kpc, v0^2 = G M / r_s"},
        "m": "m^2 = |x|^2 + (1/q^2 - 1) (n.x)^2, n the axis",
        "worst_relative_difference_between_ways_of_mpmath": internal,
        "cases": cases})


if __name__ == "__main__":
    main()
