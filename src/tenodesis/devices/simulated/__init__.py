"""Simulated hardware, for tests of devices and for trying them without a bench."""
