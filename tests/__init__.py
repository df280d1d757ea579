"""Tests and their references."""
