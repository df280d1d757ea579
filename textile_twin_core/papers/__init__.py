"""The papers' printed numbers beside ours, row by row."""
