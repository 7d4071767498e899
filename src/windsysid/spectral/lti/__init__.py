"""Cross-spectra of linear time-invariant equations of the user's own."""
