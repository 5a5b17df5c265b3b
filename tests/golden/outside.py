"""Potentials of galpy, gala and Agama at one point: value, acceleration and Hessian.

A frame is the matrix T that takes our position to the code's, y = T x: a rotation, or a rotation and a stretch. What the
code says of phi(y) becomes ours by the chain rule, acc = T^T acc(y) and hess = T^T hess(y) T. A mass is handed over as
G M, with our G: galpy and Agama have G = 1 then, gala a G of its own by which the product is divided.

Nothing is coded here of the potentials themselves. Each function of `galpy_potential`, `gala_potential` and
`agama_potential` names what its code calls the potential of a kind.
"""
import warnings

import numpy as np

GLORDER = 400                    # galpy's quadrature over ellipsoids
# Agama's expansion of ellipsoidal densities in spherical harmonics and splines.
LMAX, GRID_RADIAL, GRID_ENDS = 48, 200, (1e-5, 1e5)

# galpy's quadrature divides infinities at the ends.
warnings.filterwarnings("ignore", module="galpy")


def rotation(normal):
    """The matrix whose rows are the axes of a disc with this normal."""
    helper = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.5 else np.array([0.0, 1.0, 0.0])
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first), normal])


def framed(T, values):
    phi, acc, hess = values
    return phi, T.T @ acc, T.T @ hess @ T


# -------------------------------------------------------------------- galpy


def by_galpy(potential, y):
    R, z, phi = np.hypot(y[0], y[1]), y[2], np.arctan2(y[1], y[0])
    on = dict(phi=phi, use_physical=False)
    force = [potential.Rforce(R, z, **on), 0.0, potential.zforce(R, z, **on)]
    RR, zz, Rz = potential.R2deriv(R, z, **on), potential.z2deriv(R, z, **on), potential.Rzderiv(R, z, **on)
    Rt = tz = 0.0
    # On the axis all directions across it are equal.
    tt = -force[0] / R if R > 0 else RR
    if potential.isNonAxi:
        force[1] = potential.phitorque(R, z, **on) / R
        tt += potential.phi2deriv(R, z, **on) / R**2
        Rt = potential.Rphideriv(R, z, **on) / R + force[1] / R
        tz = potential.phizderiv(R, z, **on) / R
    c, s = np.cos(phi), np.sin(phi)
    to_xyz = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    cylindrical = np.array([[RR, Rt, Rz], [Rt, tt, tz], [Rz, tz, zz]])
    return potential(R, z, **on), to_xyz @ force, to_xyz @ cylindrical @ to_xyz.T


def galpy_potential(kind, GM, r_s, q=1.0, p=1.0, thickness=None):
    import galpy.potential as galpy

    if kind == "exponential":
        # The amplitude is a density: the mass is 4 pi h_R^2 h_z times it.
        amp = GM / (4 * np.pi * thickness * r_s**3)
        return galpy.MN3ExponentialDiskPotential(amp=amp, posdens=True, hr=r_s, hz=thickness * r_s)
    if kind in ("nfw_density", "nfw_triaxial"):
        # The amplitude has no axis ratios in it.
        return galpy.TriaxialNFWPotential(amp=GM / (p * q), a=r_s, b=p, c=q, glorder=GLORDER)
    return {
        "nfw": lambda: galpy.NFWPotential(amp=GM, a=r_s),
        "logarithmic": lambda: galpy.LogarithmicHaloPotential(amp=GM / r_s, core=r_s, q=q),
        "plummer": lambda: galpy.PlummerPotential(amp=GM, b=r_s),
        "miyamoto_nagai": lambda: galpy.MiyamotoNagaiPotential(amp=GM, a=r_s, b=thickness * r_s),
        # The amplitude is twice the mass.
        "hernquist": lambda: galpy.HernquistPotential(amp=2 * GM, a=r_s),
    }[kind]()


# --------------------------------------------------------------------- gala


def by_gala(potential, y):
    y = np.asarray(y, float)[:, None]
    return (
        potential.energy(y).value[0],
        -potential.gradient(y).value[:, 0],
        potential.hessian(y).value[:, :, 0],
    )


def gala_potential(kind, GM, r_s, q=1.0, thickness=None):
    import astropy.units as u
    import gala.potential as gp
    from gala.units import UnitSystem

    units = UnitSystem(u.kpc, u.Gyr, u.Msun, u.radian)
    mass = GM / gp.HernquistPotential(m=1, c=1, units=units).G
    return {
        "nfw": lambda: gp.NFWPotential(m=mass, r_s=r_s, a=1, b=1, c=q, units=units),
        "logarithmic": lambda: gp.LogarithmicPotential(
            v_c=np.sqrt(GM / r_s), r_h=r_s, q1=1, q2=1, q3=q, units=units),
        "plummer": lambda: gp.PlummerPotential(m=mass, b=r_s, units=units),
        "miyamoto_nagai": lambda: gp.MiyamotoNagaiPotential(m=mass, a=r_s, b=thickness * r_s, units=units),
        "exponential": lambda: gp.MN3ExponentialDiskPotential(
            m=mass, h_R=r_s, h_z=thickness * r_s, positive_density=True, sech2_z=False, units=units),
        "hernquist": lambda: gp.HernquistPotential(m=mass, c=r_s, units=units),
    }[kind]()


# -------------------------------------------------------------------- Agama


def by_agama(potential, y):
    phi, acc, slopes = potential.eval(np.asarray(y, float), pot=True, acc=True, der=True)
    xx, yy, zz, xy, yz, zx = slopes
    return phi, acc, -np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])


def agama_potential(kind, GM, r_s, q=1.0, p=1.0, thickness=None):
    import agama

    if kind in ("nfw_density", "nfw_triaxial"):
        density = agama.Density(
            type="Spheroid", alpha=1, beta=3, gamma=1, scaleRadius=r_s, axisRatioY=p, axisRatioZ=q,
            densityNorm=GM / (4 * np.pi * p * q * r_s**3))
        ends = dict(zip(("rmin", "rmax"), (end * r_s for end in GRID_ENDS)))
        return agama.Potential(
            type="Multipole", density=density, lmax=LMAX, mmax=LMAX, gridSizeR=GRID_RADIAL, **ends)
    return {
        "nfw": lambda: agama.Potential(type="NFW", mass=GM, scaleRadius=r_s),
        "logarithmic": lambda: agama.Potential(
            type="Logarithmic", v0=np.sqrt(GM / r_s), scaleRadius=r_s, axisRatioY=1, axisRatioZ=q),
        "plummer": lambda: agama.Potential(type="Plummer", mass=GM, scaleRadius=r_s),
        "miyamoto_nagai": lambda: agama.Potential(
            type="MiyamotoNagai", mass=GM, scaleRadius=r_s, scaleHeight=thickness * r_s),
        "hernquist": lambda: agama.Potential(type="Dehnen", mass=GM, scaleRadius=r_s, gamma=1),
    }[kind]()
