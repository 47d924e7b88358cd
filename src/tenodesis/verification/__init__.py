"""Independent checks of the statics: the same joint in code that shares nothing with the core."""
