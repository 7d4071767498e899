"""Nuisance effects: everything in a record that is not the structure."""
