"""Independent code that results are compared with: MuJoCo, Pinocchio, SciPy, and plants apart from the twin."""
