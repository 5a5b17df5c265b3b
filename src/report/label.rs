//! Symbols of the columns in figures.

/// (name in files, symbol in figures); units come from the run.
const SIGNS: [(&str, &str); 19] = [
    ("log10_m_halo", "log M halo"),
    ("r_s_halo_kpc", "r\u{209b} halo"),
    ("dir_x", "dir x"),
    ("dir_y", "dir y"),
    ("dir_z", "dir z"),
    ("log10_m_prog", "log m prog"),
    ("r_s_prog_kpc", "r\u{209b} prog"),
    ("x0_kpc", "x\u{2080}"),
    ("z0_kpc", "z\u{2080}"),
    ("vx0_km_s", "vx\u{2080}"),
    ("vy0_km_s", "vy\u{2080}"),
    ("vz0_km_s", "vz\u{2080}"),
    ("age_gyr", "age"),
    ("axis_x", "axis x"),
    ("axis_y", "axis y"),
    ("axis_z", "axis z"),
    ("log10_m200_halo", "log M\u{2082}\u{2080}\u{2080}"),
    ("mu_pop", "\u{3bc} of q"),
    ("sigma_pop", "\u{3c3} of q"),
];

/// A column's symbol in figures; its own name where there is none.
fn symbol(name: &str) -> &str {
    SIGNS.iter().find(|s| s.0 == name).map_or(name, |s| s.1)
}

/// A column on an axis: symbol and, where there is one, unit, on a line of its own where there is little room.
#[must_use]
pub fn axis(name: &str, unit: &str, narrow: bool) -> String {
    if unit.is_empty() {
        return symbol(name).to_owned();
    }
    let gap = if narrow { '\n' } else { ' ' };
    format!("{}{gap}[{unit}]", symbol(name))
}
