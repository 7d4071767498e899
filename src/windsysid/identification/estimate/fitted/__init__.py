"""What a fit implies: modes, residuals, its linearisation, influence of what is left out."""
