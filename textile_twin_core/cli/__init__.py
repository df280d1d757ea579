"""The command textile-twin."""
