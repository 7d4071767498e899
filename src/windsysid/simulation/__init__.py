"""What a turbine's sensors record: random loads or wind, integrated between samples."""
