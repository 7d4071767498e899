"""Modes from free decays: release, start by the eigensystem realization algorithm, maximum likelihood."""
