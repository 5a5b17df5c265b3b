//! The constants against the values they are derived from.

use oblate::units::{G, KM_S_IN_KPC_PER_GYR};

#[test]
fn g_is_the_field_value_in_our_units() {
    let from_km_s = 4.30091e-6 * KM_S_IN_KPC_PER_GYR * KM_S_IN_KPC_PER_GYR;
    assert!((G / from_km_s - 1.0).abs() < 1e-15);
}
