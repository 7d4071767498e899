"""The spectrum of a turning rotor in narrow frequency ranges around its modes."""
