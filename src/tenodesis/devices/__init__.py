"""Devices: benches behind one interface, in hardware or simulated."""
