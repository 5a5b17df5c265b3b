//! Targets with plateaus, ridges and many peaks; no gradients.
