//! Targets with exactly known evidence and posterior, shared by the tests of all samplers.

pub mod bell;
pub mod hard;
pub mod smooth;
