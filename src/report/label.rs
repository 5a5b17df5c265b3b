//! Symbols and units of the columns in figures and tables, as markup.

use super::text::literal;

/// (name in files, symbol, unit after it); of other columns the name and the unit of the run are shown.
const SIGNS: [(&str, &str, &str); 37] = [
    ("log10_m_halo", "log_{10} *M*_{halo} / *M*_{\u{2299}}", ""),
    ("r_s_halo_kpc", "*R*_{s, halo}", "kpc"),
    ("dir_x", "dir_{x}", ""),
    ("dir_y", "dir_{y}", ""),
    ("dir_z", "dir_{z}", ""),
    ("log10_m_prog", "log_{10} *m*_{prog} / *M*_{\u{2299}}", ""),
    ("r_s_prog_kpc", "*r*_{s, prog}", "kpc"),
    ("x0_kpc", "*x*_{0}", "kpc"),
    ("z0_kpc", "*z*_{0}", "kpc"),
    ("vx0_km_s", "*v*_{x, 0}", "km s^{\u{2212}1}"),
    ("vy0_km_s", "*v*_{y, 0}", "km s^{\u{2212}1}"),
    ("vz0_km_s", "*v*_{z, 0}", "km s^{\u{2212}1}"),
    ("age_gyr", "age", "Gyr"),
    ("jitter", "jitter", ""),
    ("distance_factor", "*D* / *D*_{file}", ""),
    ("phi0_deg", "\u{3c6}_{0}", "deg"),
    ("log10_m_disc", "log_{10} *M*_{disc} / *M*_{\u{2299}}", ""),
    ("r_disc_kpc", "*R*_{disc}", "kpc"),
    ("inclination_disc_deg", "*i*_{disc}", "deg"),
    ("phi_disc_deg", "\u{3c6}_{disc}", "deg"),
    ("log10_m_bulge", "log_{10} *M*_{bulge} / *M*_{\u{2299}}", ""),
    ("r_bulge_kpc", "*r*_{bulge}", "kpc"),
    ("v_host_km_s", "*v*_{host}", "km s^{\u{2212}1}"),
    ("log10_n_stars", "log_{10} *N*_{stars}", ""),
    ("p_halo", "*p*", ""),
    ("psi_halo_deg", "\u{3c8}", "deg"),
    ("m_prog_left", "*m*_{today} / *m*_{prog}", ""),
    ("dissolved_at", "*s*_{dissolved}", ""),
    ("release_peaking", "\u{3b1}_{release}", ""),
    ("coulomb_logarithm", "ln \u{39b}", ""),
    ("q", "*q*", ""),
    ("axis_x", "*n*_{x}", ""),
    ("axis_y", "*n*_{y}", ""),
    ("axis_z", "*n*_{z}", ""),
    ("log10_m200_halo", "log_{10} *M*_{200} / *M*_{\u{2299}}", ""),
    ("mu_pop", "\u{3bc}_{pop}", ""),
    ("sigma_pop", "\u{3c3}_{pop}", ""),
];

/// A column's symbol and unit, which may be empty; `unit` is that of the run.
#[must_use]
pub fn sign(name: &str, unit: &str) -> (String, String) {
    match SIGNS.iter().find(|sign| sign.0 == name) {
        Some((_, symbol, unit)) => ((*symbol).to_owned(), (*unit).to_owned()),
        None => (literal(name), literal(unit)),
    }
}

/// A column on an axis: symbol and, where there is one, unit, on a line of its own where there is little room.
#[must_use]
pub fn axis(name: &str, unit: &str, narrow: bool) -> String {
    let (symbol, unit) = sign(name, unit);
    if unit.is_empty() {
        return symbol;
    }
    let gap = if narrow { '\n' } else { ' ' };
    format!("{symbol}{gap}[{unit}]")
}
