"""Access to files that may be damaged or large."""
