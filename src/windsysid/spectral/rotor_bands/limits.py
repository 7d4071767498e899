"""Limits of a turning rotor's spectra in narrow bands; those without a source were set on simulated records."""

MAX_LIGHT_DAMPING = 0.01
"""Size: damping ratio below which a rotor is analysed in bands: resonances are so narrow compared with the prior that a
search that does not start at their peaks converges to another point."""

MIN_BLADES_FREEDOM, MIN_SUPPORT_FREEDOM = 4.0, 0.7
"""Size: equivalent degrees of freedom within the narrowest resonance (``python -m validation.field_spectral``): in
windows of 120 s of OpenFAST's records, where the blades have 3, whirl modes lie outside their intervals; in 180 s,
where they have 4.8, inside. An energy has the former at least; a resonance as narrow as a bin shows fewer."""

MIN_PEAK_LOG_ODDS = 8.0
"""Log odds: gain in log-likelihood of a peak; below it the peak is too weak."""

MIN_RIVAL_DISTANCE = 0.04
"""Size: relative distance in frequency of such a peak from the best one."""

BLADE_STIFFNESS_DISCREPANCY = 0.005
"""Setting: prior standard deviation of the ratio of the stiffness of an equivalent hinge to that which the modes of a
bending blade show. Edgewise frequencies by the hinge are 0.0 to 0.3 % off OpenFAST's linearisation (docs/nrel5mw.md,
``windsysid turbine``), and 0.3 to 0.4 % in its records under wind (docs/spectral.md): a standard
deviation of 0.25 %, which is 0.5 % of a stiffness."""
