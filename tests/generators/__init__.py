"""Recordings and exact numbers that the tests are held against; nothing here uses the engine."""
