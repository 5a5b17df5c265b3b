//! Smooth targets with exact gradients.
