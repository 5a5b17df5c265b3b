//! The constants against the values they are derived from.

use oblate::units::{G, KPC_PER_GYR_IN_KM_S};

#[test]
fn g_is_the_field_value_in_our_units() {
    let from_km_s = 4.30091e-6 * KPC_PER_GYR_IN_KM_S * KPC_PER_GYR_IN_KM_S;
    assert!((G / from_km_s - 1.0).abs() < 1e-15);
}
