//! How columns are called on axes.

/// (name in files, sign in figures): units come from the run.
const SIGNS: [(&str, &str); 18] = [
    ("log10_m_halo", "log M\u{2095}"),
    ("r_s_halo_kpc", "r\u{209b},\u{2095}"),
    ("dir_x", "dir x"),
    ("dir_y", "dir y"),
    ("dir_z", "dir z"),
    ("log10_m_prog", "log m\u{209a}"),
    ("r_s_prog_kpc", "r\u{209b},\u{209a}"),
    ("x0_kpc", "x\u{2080}"),
    ("z0_kpc", "z\u{2080}"),
    ("vx0_km_s", "v\u{2093},\u{2080}"),
    ("vy0_km_s", "v\u{1d67},\u{2080}"),
    ("vz0_km_s", "v_z,\u{2080}"),
    ("age_gyr", "age"),
    ("axis_x", "axis x"),
    ("axis_y", "axis y"),
    ("axis_z", "axis z"),
    ("mu_pop", "\u{3bc} of q"),
    ("sigma_pop", "\u{3c3} of q"),
];

/// A column's sign in figures; its own name where there is none.
fn sign(name: &str) -> &str {
    SIGNS.iter().find(|s| s.0 == name).map_or(name, |s| s.1)
}

/// A column on an axis: sign and, where there is one, unit.
#[must_use]
pub fn axis(name: &str, unit: &str) -> String {
    if unit.is_empty() {
        sign(name).to_owned()
    } else {
        format!("{} [{unit}]", sign(name))
    }
}
