"""Command textile-twin."""
