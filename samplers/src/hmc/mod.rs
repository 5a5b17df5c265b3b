//! Hamiltonian moves: one trajectory and its adaptation.
