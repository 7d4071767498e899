"""Text files: lines, dialects and dates."""
