"""The posterior of the unknowns: by filters, by spectra, online."""
