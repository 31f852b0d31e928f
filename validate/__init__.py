"""Estimates against truth: metrics, calibration, statistics, gate, report."""
