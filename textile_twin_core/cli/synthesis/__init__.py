"""Tasks of textile-twin synthesize."""
