"""Judges the shaft's estimators: kinds with known truth and a real engine, beside a textbook filter tuned on each."""
