"""Tests and what they are held against."""
