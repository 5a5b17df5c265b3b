"""Log density of the normal truncated to [lo, hi], and its derivatives, to 200 digits.

python truncated_normal.py > truncated_normal.json

The density is coded as it is defined; derivatives are central differences with a relative step of 1e-60.
"""

import json

import mpmath as mp

mp.mp.dps = 200

# lo, hi, mu, sigma, q
CASES = [
    (0.5, 1.5, 1.0, 0.1, 1.0),
    (0.5, 1.5, 1.0, 0.1, 0.5),
    (0.5, 1.5, 0.85, 0.25, 1.4),
    (0.5, 1.5, 0.5, 0.1, 0.5),
    (0.5, 1.5, 0.5, 0.1, 0.75),
    (0.5, 1.5, 1.5, 1e-3, 1.499),
    (0.5, 1.5, 1.5, 1e-9, 1.5),
    (0.5, 1.5, 1.0, 1e-6, 1.0000001),
    (0.5, 1.5, 0.50000001, 1e-3, 0.5),
    (0.5, 1.5, 0.49999999, 1e-3, 0.5),
    (0.5, 1.5, 1.2, 1.0, 0.6),
    (0.5, 1.5, 1.0, 1e3, 0.7),
    (0.5, 1.5, 1.0, 1e6, 0.7),
    (0.5, 1.5, 1.7, 0.05, 1.45),
    (0.5, 1.5, 0.0, 0.01, 0.5002),
    (0.5, 1.5, 3.0, 0.001, 1.4999999),
    (0.5, 1.5, -8.0, 0.001, 0.5000001),
    (0.5, 1.5, -8.0, 10.0, 1.3),
    (0.5, 1.5, 20.0, 300.0, 0.9),
    (0.5, 1.5, 1.6, 0.5, 0.5),
    (0.5, 1.5, 1.5000001, 0.2, 1.1),
    (0.0, 1.0, 12.0, 2.0, 0.25),
    (0.0, 1.0, -40.0, 1.0, 0.9),
]


def ln_pdf(lo, hi, mu, sigma, q):
    a, b = ((x - mu) / (sigma * mp.sqrt(2)) for x in (lo, hi))
    # The same difference from the side where it does not cancel: a far tail would need millions of digits.
    if a > 0:
        mass = mp.erfc(a) - mp.erfc(b)
    elif b < 0:
        mass = mp.erfc(-b) - mp.erfc(-a)
    else:
        mass = mp.erf(b) + mp.erf(-a)
    return -((q - mu) ** 2) / (2 * sigma**2) - mp.log(sigma * mp.sqrt(2 * mp.pi)) - mp.log(mass / 2)


def reference(*case):
    lo, hi, mu, sigma, q = (mp.mpf(x) for x in case)
    h_mu = mp.mpf(10) ** -60 * max(abs(mu), sigma)
    h_sigma = mp.mpf(10) ** -60 * sigma
    return (
        ln_pdf(lo, hi, mu, sigma, q),
        (ln_pdf(lo, hi, mu + h_mu, sigma, q) - ln_pdf(lo, hi, mu - h_mu, sigma, q)) / (2 * h_mu),
        (ln_pdf(lo, hi, mu, sigma + h_sigma, q) - ln_pdf(lo, hi, mu, sigma - h_sigma, q)) / (2 * h_sigma),
    )


cases = []
for case in CASES:
    value, d_mu, d_sigma = reference(*case)
    lo, hi, mu, sigma, q = case
    cases.append(
        {
            "lo": lo,
            "hi": hi,
            "mu": mu,
            "sigma": sigma,
            "q": q,
            "ln_pdf": float(value),
            "d_mu": float(d_mu),
            "d_sigma": float(d_sigma),
        }
    )
print(json.dumps({"cases": cases}, indent=1))
