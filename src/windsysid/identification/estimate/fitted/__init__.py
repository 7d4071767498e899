"""Properties of a fit: modes, residuals, linearisation, influence of single frequencies."""
