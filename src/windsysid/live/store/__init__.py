"""What is known of every turbine, on disk: SQLite or PostgreSQL."""
