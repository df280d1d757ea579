"""Printed numbers of the papers and computed ones, row by row."""
