"""The tasks of textile-twin synthesize."""
