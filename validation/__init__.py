"""Trials of windsysid that are not part of it: each is a module that runs and prints what it found."""
